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

# The ridge of the linear part, relative to the variance of an input; and the initial weights of the network's last
# layer beside it, relative to torch's.
RIDGE, _SMALL = 1e-6, 0.1


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
        targets = self._targets
        model = untrained(self._options, self._n_rows, targets.modes, targets.scale, self._z, seed)
        if self._options.linear:
            start_from_linear(model, self._fitted(model))
        return model

    def _fitted(self, model: InternalModel) -> Tensor:
        """L by ridge regression of the coefficients on the inputs, both scaled."""
        targets = self._targets
        z, target = (self._z / model.input_scale).double(), (targets.target / targets.scale).double()
        gram = z.T @ z + RIDGE * len(z) * torch.eye(z.shape[1], dtype=z.dtype)
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


def untrained(
    options: InternalOptions, n_rows: int, modes: Tensor, scale: Tensor, inputs: Tensor, seed: int
) -> InternalModel:
    """With weights from the seed; components (count, n_nodes, dim), scales of their coefficients (count,), and the
    training inputs (s, n_inputs), whose spread scales them."""
    _, n_nodes, dim = modes.shape
    model = seeded(lambda: InternalModel(options, dim, n_rows, n_nodes), seed)
    model.modes.copy_(modes)
    model.coefficient_scale.copy_(scale)
    model.input_scale.copy_(spread(inputs))
    if options.gravity:  # a direction, which may hardly change
        model.input_scale[-dim:] = 1.0
    return model


def start_from_linear(model: InternalModel, linear: Tensor) -> None:
    """Sets the linear part L, and starts the network beside it small."""
    model.linear.copy_(linear)
    for weights in (model.network.head.weight, model.network.head.bias):
        weights.mul_(_SMALL)
