"""The training task of learned contact forces."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from softprint.runtime.learned.force.confidence import squared_ratio
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.surrogate.force.data import ForceData
from softprint.surrogate.force.loss import ForceMetric, on_nodes, quadratic_form
from softprint.surrogate.learning_task import HeldOutError, seeded, some_samples

# kappa of `loss.py`. Compared with infinity, the error on validation shapes is the same, and on the shallower half of
# their samples it is a fifth lower.
_SHALLOW = 0.1


class ForceTask:
    """Trains a `ForceModel` on `ForceData`."""

    def __init__(
        self,
        options: ForceModelOptions,
        metric: ForceMetric,
        data: ForceData,
        validation: ForceData,
        n_rows: int,
        notes: dict[str, Any] | None = None,
    ) -> None:
        self._options, self._data, self._validation, self._n_rows = options, data, validation, n_rows
        self._notes = notes or {}
        self._gamma = metric.gamma.to(self.device)
        self._volume_gamma = metric.volume_gamma.to(self.device)
        weight = 1.0 / (data.squared + _SHALLOW * data.squared.mean())
        self._weight = weight / (weight * data.squared).mean()

    @property
    def n_samples(self) -> int:
        return len(self._data)

    @property
    def device(self) -> torch.device:
        return self._data.depth.device

    @property
    def identity(self) -> dict[str, Any]:
        return {"form": ForceModel.form, **self._options.to_json()}

    @property
    def notes(self) -> dict[str, Any]:
        return self._notes

    def fresh_model(self, seed: int) -> ForceModel:
        """Initial weights from the seed, normalisation from the data."""
        data, dim = self._data, self._data.force.shape[-1]
        model = seeded(lambda: ForceModel(self._options, dim, self._n_rows), seed).to(self.device)
        some = some_samples(len(data), seed, self.device)
        there = data.present[some] > 0
        model.normalise(data.local[some][there], data.depth, data.force[some][there], data.lever[some][there])
        model.confidence.span(model.normalised(data.local[data.present > 0]))
        return model

    def loss(self, model: ForceModel, index: Tensor) -> Tensor:
        """The weighted mean squared error in the norm M, relative to the weighted mean square of the displacement."""
        error, _ = self._squared_errors(model, self._data, index, self._gamma, volume_only=False)
        return (error * self._weight[index]).mean()

    @torch.no_grad()
    def held_out_error(self, model: ForceModel, batch: int = 64) -> HeldOutError:
        """Error over the volume of the validation samples, with fields pulled back to rest coordinates."""
        data = self._validation
        parts = [
            self._squared_errors(model, data, index, self._volume_gamma, volume_only=True)
            for index in torch.arange(len(data), device=self.device).split(batch)
        ]
        error, whole = (torch.cat(column).double() for column in zip(*parts, strict=True))
        return HeldOutError(
            float((error.sum() / whole.sum()).clamp(min=0.0).sqrt()),
            float((error / whole).max().clamp(min=0.0).sqrt()),
            len(data),
        )

    @torch.no_grad()
    def finish(self, model: ForceModel, batch: int = 256) -> None:
        """Set the largest correction the confidence factor admits, from the corrections of the training contacts."""
        data = self._data
        ratios = []
        for part in torch.arange(len(data), device=self.device).split(batch):
            force = data.force[part]
            correction = model.correction(data.local[part], data.depth[part], force, data.lever[part])
            ratios.append(squared_ratio(force, correction).sqrt())
        model.confidence.limit(torch.cat(ratios))

    @staticmethod
    def _squared_errors(
        model: ForceModel, data: ForceData, index: Tensor, gamma: Tensor, volume_only: bool
    ) -> tuple[Tensor, Tensor]:
        """(squared error (b,), squared displacement (b,)) of the samples `index` (b,)."""
        count = data.present[index].sum(1).long()
        m = int(count.max())
        present = data.present[index, :m, None]
        lever = data.lever[index, :m]
        phi = model(data.local[index, :m], data.depth[index], data.force[index, :m], lever) * present
        h, c = (data.volume_h, data.volume_squared) if volume_only else (data.h, data.squared)
        nodes, n_nodes = data.nodes[index], data.n_nodes[index]
        forces = on_nodes(phi, data.corners[index, :m], data.shares[index, :m], int(n_nodes.max()))
        quadratic = quadratic_form(gamma, nodes, n_nodes, forces)
        return quadratic - 2.0 * (phi * h[index, :m]).sum((1, 2)) + c[index], c[index]
