"""The training task of an internal correction (thesis 4.3.3): coefficients of principal components from a state."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from softprint.runtime.learned.internal.model import InternalModel, InternalOptions
from softprint.runtime.learned.network import spread
from softprint.surrogate.data.component_targets import ComponentTargets
from softprint.surrogate.internal.data import InternalData
from softprint.surrogate.learning_task import HeldOutError, seeded

# Of the linear part: the ridge, relative to the variance of an input; and the initial weights of the network's last
# layer beside it, relative to torch's.
_RIDGE, _SMALL = 1e-6, 0.1


class InternalTask:
    """Trains an `InternalModel` on `InternalData`."""

    def __init__(self, options: InternalOptions, data: InternalData, n_rows: int) -> None:
        self._options, self._n_rows = options, n_rows
        self._z = torch.from_numpy(data.inputs[data.train]).float()
        self._held_z = torch.from_numpy(data.inputs[data.held_out]).float()
        fields = data.fields[data.train], data.fields[data.held_out]
        self._targets = ComponentTargets(*fields, data.volumes, options.components)

    @property
    def n_samples(self) -> int:
        return len(self._z)

    @property
    def device(self) -> torch.device:
        return self._z.device

    @property
    def identity(self) -> dict[str, Any]:
        return {"form": InternalModel.form, **self._options.to_json()}

    @property
    def notes(self) -> dict[str, Any]:
        """discarded: the energy beyond the principal components, as a share of that of the training fields."""
        return {"discarded": self._targets.discarded}

    @torch.no_grad()
    def fresh_model(self, seed: int) -> InternalModel:
        """Initial weights from the seed; components and scales from the data."""
        _, n_nodes, dim = self._targets.modes.shape
        model = seeded(lambda: InternalModel(self._options, dim, self._n_rows, n_nodes), seed)
        model.modes.copy_(self._targets.modes)
        model.coefficient_scale.copy_(self._targets.scale)
        model.input_scale.copy_(spread(self._z))
        if self._options.gravity:  # a direction, which may hardly change
            model.input_scale[-dim:] = 1.0
        if self._options.linear:
            model.linear.copy_(self._fitted(model))
            for weights in (model.network.head.weight, model.network.head.bias):
                weights.mul_(_SMALL)
        return model

    def _fitted(self, model: InternalModel) -> Tensor:
        """L by ridge regression of the coefficients on the inputs, both scaled."""
        targets = self._targets
        z, target = (self._z / model.input_scale).double(), (targets.target / targets.scale).double()
        gram = z.T @ z + _RIDGE * len(z) * torch.eye(z.shape[1], dtype=z.dtype)
        return torch.linalg.solve(gram, z.T @ target).T.float()

    def loss(self, model: InternalModel, index: Tensor) -> Tensor:
        """See `ComponentTargets`."""
        return self._targets.loss(model(self._z[index]), index)

    @torch.no_grad()
    def held_out_error(self, model: InternalModel) -> HeldOutError:
        """Error of r over the volume, relative to r itself."""
        return self._targets.held_out_error(model(self._held_z))

    def finish(self, model: InternalModel) -> None:
        """Nothing to set."""
