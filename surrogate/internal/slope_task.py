"""Training of an internal correction on the derivatives of the equilibria as well as on the equilibria themselves.

    loss = mean_s w_s |c(z_s) - c_s|^2 / mean_s w_s |c_s|^2
         + weight * mean_s |dc(z_s) t - dc_s t|^2 / mean_s |dc_s t|^2,

in random directions t of the coordinates. A state knows its derivatives in all of them, which are tens of further
states each: with as many states, held-out errors are a fraction of those of the values alone.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from softprint.runtime.learned.internal.model import InternalModel, InternalOptions
from softprint.surrogate.internal.data import InternalData
from softprint.surrogate.internal.slope_data import SlopeData
from softprint.surrogate.internal.task import RIDGE, start_from_linear, untrained
from softprint.surrogate.learning_task import HeldOutError

# Of the derivatives in the loss; and the number of directions of a state in a batch.
_WEIGHT, _DIRECTIONS = 0.01, 2


class SlopeTask:
    """Trains an `InternalModel` on `InternalData` and the `SlopeData` of its training states."""

    def __init__(self, options: InternalOptions, data: InternalData, slopes: SlopeData, n_rows: int) -> None:
        self._options, self._n_rows, self._slopes = options, n_rows, slopes
        self._z = torch.from_numpy(data.inputs[data.train]).float()
        self._sloped = torch.from_numpy(slopes.sloped)
        self._dz = torch.from_numpy(slopes.input_slopes).float()
        self._c = torch.from_numpy(slopes.coefficients).float()
        self._dc = torch.from_numpy(slopes.slopes).float()
        weights = torch.from_numpy(slopes.weights).float()
        self._weights = weights / (weights * self._c.square().sum(1)).mean()
        self._slope_weight = _WEIGHT / self._dc.square().sum(2).mean()
        self._held_z = torch.from_numpy(data.inputs[data.held_out]).float()
        self._held = torch.from_numpy(data.fields[data.held_out])
        self._volumes = torch.from_numpy(data.volumes)[:, None]

    @property
    def n_samples(self) -> int:
        return len(self._z)

    @property
    def device(self) -> torch.device:
        return self._z.device

    @property
    def identity(self) -> dict[str, Any]:
        return {"form": InternalModel.form, "derivatives": True, **self._options.to_json()}

    @property
    def notes(self) -> dict[str, Any]:
        """discarded: the share of fields and derivatives beyond the principal components."""
        return {"discarded": self._slopes.discarded}

    @torch.no_grad()
    def fresh_model(self, seed: int) -> InternalModel:
        """Initial weights from the seed; components and scales from the data."""
        modes, scale = torch.from_numpy(self._slopes.modes), self._c.square().mean(0).sqrt()
        model = untrained(self._options, self._n_rows, modes, scale, self._z, seed)
        if self._options.linear:
            start_from_linear(model, self._fitted(model))
        return model

    def _fitted(self, model: InternalModel) -> Tensor:
        """L by ridge regression of coefficients and their derivatives on the inputs and theirs, weighted as the
        loss."""
        z, dz = (self._z / model.input_scale).double(), (self._dz / model.input_scale).double()
        c, dc = ((own / model.coefficient_scale).double() for own in (self._c, self._dc))
        weighted = self._weights[:, None] * z / len(z)
        dz, dc = dz.flatten(0, 1), dc.flatten(0, 1)
        turned = self._slope_weight * dz / len(dz)
        gram = weighted.T @ z + turned.T @ dz + RIDGE * torch.eye(z.shape[1], dtype=z.dtype)
        return torch.linalg.solve(gram, weighted.T @ c + turned.T @ dc).T.float()

    def loss(self, model: InternalModel, index: Tensor) -> Tensor:
        """In directions that are drawn from the batch, so that a resumed run draws the same ones. The states with
        derivatives are drawn beside those of the batch."""
        n_dofs = self._dz.shape[1]
        seed = int((index * torch.arange(1, len(index) + 1)).sum())
        drawn = torch.Generator().manual_seed(seed)
        directions = torch.randn(len(index), _DIRECTIONS, n_dofs, generator=drawn)
        other = index % len(self._dz)
        _, slope = model.along(self._z[self._sloped[other]], directions @ self._dz[other])
        missed = (model(self._z[index]) - self._c[index]).square().sum(1)
        turned = (slope - directions @ self._dc[other]).square().sum(2)
        return (self._weights[index] * missed).mean() + self._slope_weight * turned.mean() / n_dofs

    @torch.no_grad()
    def held_out_error(self, model: InternalModel) -> HeldOutError:
        """Error of r over the volume, relative to r itself."""
        found = torch.tensordot(model(self._held_z).double(), model.modes.double(), dims=1)
        error = ((found - self._held).square() * self._volumes).sum((1, 2))
        whole = (self._held.square() * self._volumes).sum((1, 2))
        return HeldOutError.of(error, whole)

    def finish(self, model: InternalModel) -> None:
        """Nothing to set."""
