"""The training task of an internal correction (thesis 4.3.3): coefficients of principal components from a state.

The components are orthonormal in the volume, so that the mean squared error of coefficients is that of the displacement
over the volume. The held-out error is that of the whole field, with what the components leave out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.learned.internal.model import InternalModel, InternalOptions
from softprint.runtime.learned.network import spread
from softprint.surrogate.internal.components import principal_components
from softprint.surrogate.internal.data import InternalData
from softprint.surrogate.learning_task import HeldOutError, seeded

# Of the linear part: the ridge, relative to the variance of an input; and the initial weights of the network's last
# layer beside it, relative to torch's.
_RIDGE, _SMALL = 1e-6, 0.1


class InternalTask:
    """Trains an `InternalModel` on `InternalData`."""

    def __init__(self, options: InternalOptions, data: InternalData, n_rows: int) -> None:
        self._options, self._n_rows = options, n_rows
        components = principal_components(data.fields[data.train], data.volumes, options.components)
        self._discarded = components.discarded
        self._modes = torch.from_numpy(components.modes).float()
        self._z = torch.from_numpy(data.inputs[data.train]).float()
        self._target = torch.from_numpy(components.coefficients).float()
        self._scale = self._target.square().mean(0).sqrt()
        fields, volumes = data.fields[data.held_out], data.volumes
        self._held_z = torch.from_numpy(data.inputs[data.held_out]).float()
        projected = np.einsum("snd,knd,n->sk", fields, components.modes, volumes, optimize=True)
        self._held_target = torch.from_numpy(projected)
        self._held_energy = torch.from_numpy(np.einsum("snd,n->s", fields**2, volumes))

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
        return {"discarded": self._discarded}

    @torch.no_grad()
    def fresh_model(self, seed: int) -> InternalModel:
        """Initial weights from the seed; components and scales from the data."""
        _, n_nodes, dim = self._modes.shape
        model = seeded(lambda: InternalModel(self._options, dim, self._n_rows, n_nodes), seed)
        model.modes.copy_(self._modes)
        model.coefficient_scale.copy_(self._scale)
        model.input_scale.copy_(spread(self._z))
        if self._options.linear:
            model.linear.copy_(self._fitted(model))
            for weights in (model.network.head.weight, model.network.head.bias):
                weights.mul_(_SMALL)
        return model

    def _fitted(self, model: InternalModel) -> Tensor:
        """L by ridge regression of the coefficients on the inputs, both scaled."""
        z, target = (self._z / model.input_scale).double(), (self._target / self._scale).double()
        gram = z.T @ z + _RIDGE * len(z) * torch.eye(z.shape[1], dtype=z.dtype)
        return torch.linalg.solve(gram, z.T @ target).T.float()

    def loss(self, model: InternalModel, index: Tensor) -> Tensor:
        """Squared error of the field over the volume, relative to the mean square of the targets."""
        error = (model(self._z[index]) - self._target[index]).square().sum(1)
        return error.mean() / self._scale.square().sum()

    @torch.no_grad()
    def held_out_error(self, model: InternalModel) -> HeldOutError:
        """Error of r over the volume, relative to r itself."""
        found = model(self._held_z).double()
        beyond = self._held_energy - self._held_target.square().sum(1)
        error = (found - self._held_target).square().sum(1) + beyond.clamp(min=0.0)
        whole = self._held_energy
        return HeldOutError(
            float((error.sum() / whole.sum()).sqrt()),
            float((error / whole.clamp(min=1e-6 * whole.mean())).max().sqrt()),
            len(whole),
        )

    def finish(self, model: InternalModel) -> None:
        """Nothing to set."""
