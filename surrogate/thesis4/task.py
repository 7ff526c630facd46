"""The training task of an object-centric correction (thesis 4.3.3): coefficients of principal components from the place
of the collider."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from softprint.runtime.arrays import Array
from softprint.runtime.learned.thesis4.model import ObjectCentricModel, ObjectCentricOptions
from softprint.surrogate.data.component_targets import ComponentTargets
from softprint.surrogate.learning_task import HeldOutError, seeded
from softprint.surrogate.thesis4.data import ObjectCentricData, TrainedColliders
from softprint.surrogate.thesis4.loss import held_out_error, object_centric_loss


class ObjectCentricTask:
    """Trains an `ObjectCentricModel`. volumes: of the nodes (n_nodes,); colliders: those of the data;
    input_gain: on the initial weights of the first layer, which tanh needs to tell contacts apart that are a few
    millimetres from each other on a body of centimetres."""

    def __init__(
        self,
        options: ObjectCentricOptions,
        data: ObjectCentricData,
        validation: ObjectCentricData,
        volumes: Array,
        n_rows: int,
        colliders: TrainedColliders,
        input_gain: float,
        device: torch.device | None = None,
    ) -> None:
        self._options, self._n_rows, self._colliders = options, n_rows, colliders
        self._input_gain = input_gain
        self.targets = ComponentTargets(data.fields, validation.fields, volumes, options.components, device)
        self._z, self._depth = (_tensor(part, device) for part in (data.inputs, data.depth))
        self._held_z, self._held_depth = (
            _tensor(part, device) for part in (validation.inputs, validation.depth)
        )

    @property
    def n_samples(self) -> int:
        return len(self._z)

    @property
    def device(self) -> torch.device:
        return self._z.device

    @property
    def identity(self) -> dict[str, Any]:
        return {
            "form": ObjectCentricModel.form,
            **self._options.to_json(),
            "input_gain": self._input_gain,
        }

    @property
    def notes(self) -> dict[str, Any]:
        """discarded: the energy beyond the principal components, as a share of that of the training fields."""
        return {"discarded": self.targets.discarded}

    @torch.no_grad()
    def fresh_model(self, seed: int) -> ObjectCentricModel:
        """Initial weights from the seed; components and scales from the data."""
        dim = self.targets.modes.shape[2]
        model = seeded(lambda: ObjectCentricModel(self._options, dim, self._n_rows), seed).to(self.device)
        model.modes.copy_(self.targets.modes)
        model.coefficient_scale.copy_(self.targets.scale / model.fade.value(self._depth).mean())
        model.normalise(self._z)
        model.shape.copy_(torch.from_numpy(self._colliders.shape))
        model.sizes.copy_(torch.from_numpy(self._colliders.sizes))
        for weights in (model.network.local.weight, model.network.local.bias):
            weights *= self._input_gain
        return model

    def loss(self, model: ObjectCentricModel, index: Tensor) -> Tensor:
        """See `object_centric_loss`."""
        return object_centric_loss(model, self.targets, self._z[index], self._depth[index], index)

    def held_out_error(self, model: ObjectCentricModel) -> HeldOutError:
        """Error of r on the held-out samples."""
        return held_out_error(model, self.targets, self._held_z, self._held_depth)

    def finish(self, model: ObjectCentricModel) -> None:
        """Nothing to set."""


def _tensor(values: Array, device: torch.device | None) -> Tensor:
    return torch.from_numpy(values).float().to(device)
