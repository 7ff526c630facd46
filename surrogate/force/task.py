"""The training task of learned contact forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import pad

from softprint.runtime.learned.force.confidence import contact_measures, squared_ratio
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.joint_settling import JointSettling
from softprint.surrogate.force.data import ForceData
from softprint.surrogate.force.loads import on_loads
from softprint.surrogate.force.loss import ForceMetric, quadratic_form
from softprint.surrogate.force.sample_blocks import SampleBlocks
from softprint.surrogate.learning_task import HeldOutError, seeded, some_samples

# kappa of `loss.py`. Compared with infinity, the error on validation shapes is the same, and on the shallower half of
# their samples it is a fifth lower.
SHALLOW = 0.1
# Samples evaluated together.
_BATCH = 64


@dataclass(frozen=True, eq=False)
class Samples:
    """Some samples of data, rows (s,), with their blocks of Gamma with and without the edge term."""

    data: ForceData
    rows: Tensor
    blocks: SampleBlocks
    volume_blocks: SampleBlocks

    @classmethod
    def of(cls, metric: ForceMetric, data: ForceData) -> Samples:
        """All of them, on their device."""
        device = data.depth.device
        both, volume = (
            SampleBlocks(gamma.to(device), data.loads, data.n_loads)
            for gamma in (metric.gamma, metric.volume_gamma)
        )
        return cls(data, torch.arange(len(data), device=device), both, volume)

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, index: Tensor) -> Samples:
        """Some of them; nothing is copied."""
        return replace(self, rows=self.rows[index.to(self.rows.device)])

    @property
    def batches(self) -> Sequence[Tensor]:
        """All rows, in parts."""
        return self.rows.split(_BATCH)

    @property
    def bearing(self) -> Tensor:
        """(s,) which of them have contact forces: in others no point bears."""
        forces = self.data.force[self.rows] * self.data.present[self.rows][..., None]
        return forces.square().sum((1, 2)) > 0.0


class Gains(NamedTuple):
    """Of s samples (s,), over the volume: the squared error |w_0 - w|^2 of linear mechanics, with the correction c its
    product with what is missed, <c, w - w_0>, and its square |c|^2; and the square of the displacement, |w|^2."""

    missed: Tensor
    cross: Tensor
    square: Tensor
    whole: Tensor


class ForceTask:
    """Trains a `ForceModel` on some samples, and measures its error on others; without these it is not a number."""

    def __init__(
        self,
        options: ForceModelOptions,
        learned: Samples,
        judged: Samples | None,
        n_rows: int,
        notes: dict[str, Any] | None = None,
        settling: JointSettling | None = None,
    ) -> None:
        self._options, self._learned, self._judged, self._n_rows = options, learned, judged, n_rows
        self._notes, self._settling = notes or {}, settling
        squared = learned.data.squared[learned.rows]
        weight = 1.0 / (squared + SHALLOW * squared.mean())
        self._weight = weight / (weight * squared).mean()

    @classmethod
    def of(
        cls,
        options: ForceModelOptions,
        metric: ForceMetric,
        data: ForceData,
        validation: ForceData,
        n_rows: int,
        notes: dict[str, Any] | None = None,
    ) -> ForceTask:
        """On training and validation data."""
        return cls(options, Samples.of(metric, data), Samples.of(metric, validation), n_rows, notes)

    @property
    def n_samples(self) -> int:
        return len(self._learned)

    @property
    def device(self) -> torch.device:
        return self._learned.data.depth.device

    @property
    def identity(self) -> dict[str, Any]:
        return {"form": ForceModel.form, **self._options.to_json()}

    @property
    def notes(self) -> dict[str, Any]:
        return self._notes

    def fresh_model(self, seed: int) -> ForceModel:
        """Initial weights from the seed, normalisation from the data."""
        data, rows, dim = self._learned.data, self._learned.rows, self._learned.data.force.shape[-1]
        model = seeded(lambda: ForceModel(self._options, dim, self._n_rows), seed).to(self.device)
        some = rows[some_samples(len(rows), seed, self.device)]
        there = data.present[some] > 0
        model.normalise(
            data.local[some][there], data.depth[rows], data.force[some][there], data.lever[some][there]
        )
        if self._settling is not None:
            model.settle(self._settling)
        return model

    def loss(self, model: ForceModel, index: Tensor) -> Tensor:
        """The weighted mean squared error in the norm M, relative to the weighted mean square of the displacement. The
        confidence factor is that of training, 1."""
        data, rows = self._learned.data, self._learned.rows[index]
        phi = _both_ways(_forces(data, rows)) + _correction(model, data, rows)
        error = _squared_error(self._learned, phi, rows, volume_only=False)
        return (error * self._weight[index]).mean()

    @torch.no_grad()
    def held_out_error(self, model: ForceModel) -> HeldOutError:
        """Error over the volume of the samples to judge by, with fields pulled back to rest coordinates."""
        if self._judged is None:
            return HeldOutError(float("nan"), float("nan"), 0)
        missed, cross, square, whole = (part.double() for part in self.gains(model))
        return HeldOutError.of(missed - 2.0 * cross + square, whole)

    @torch.no_grad()
    def gains(self, model: ForceModel) -> Gains:
        """Of the samples to judge by."""
        assert self._judged is not None
        judged, data, parts = self._judged, self._judged.data, list[Gains]()
        for index in judged.batches:
            force, correction = _forces(data, index), _correction(model, data, index)
            z, depth = _normalised(model, data, index)
            correction = model.confidence(z, depth, force, correction) * correction
            whole = _both_ways(force)
            missed, found = (
                _squared_error(judged, phi, index, volume_only=True) for phi in (whole, whole + correction)
            )
            square = _quadratic(judged, correction, index, volume_only=True)
            parts.append(Gains(missed, 0.5 * (missed + square - found), square, data.volume_squared[index]))
        return Gains(*(torch.cat(column) for column in zip(*parts, strict=True)))

    @torch.no_grad()
    def unfamiliarity(self, model: ForceModel) -> tuple[Tensor, Tensor]:
        """M and rho (s,) of `confidence.py`, of the contacts to judge by that have contact forces."""
        assert self._judged is not None
        return _unfamiliarity(model, self._judged)

    @torch.no_grad()
    def finish(self, model: ForceModel) -> None:
        """Set the confidence factor from the training contacts, with its limits from those to judge by."""
        data = self._learned.data
        measures = [
            contact_measures(*_normalised(model, data, index), _forces(data, index))
            for index in self._learned.batches
        ]
        bearing = self._learned.bearing
        if int(bearing.sum()) > 1:
            model.confidence.fit(torch.cat(measures)[bearing])
            distance, ratio = _unfamiliarity(model, self._judged or self._learned)
            if len(ratio):
                model.confidence.limit(distance, ratio)


def _points(data: ForceData, index: Tensor) -> int:
    """The largest number of contact points of some samples."""
    return int(data.present[index].sum(1).max())


def _forces(data: ForceData, index: Tensor) -> Tensor:
    """l (b, m, dim) of some samples, zero in the padding."""
    m = _points(data, index)
    return data.force[index, :m] * data.present[index, :m, None]


def _both_ways(force: Tensor) -> Tensor:
    """Forces (b, m, dim) on points, and none spread around them (b, m, 2 dim)."""
    return pad(force, (0, force.shape[-1]))


def _correction(model: ForceModel, data: ForceData, index: Tensor) -> Tensor:
    """c (b, m, 2 dim) of some samples, without the confidence factor, zero in the padding."""
    m = _points(data, index)
    local, force, lever = data.local[index, :m], data.force[index, :m], data.lever[index, :m]
    return model.correction(local, data.depth[index], force, lever) * data.present[index, :m, None]


def _normalised(model: ForceModel, data: ForceData, index: Tensor) -> tuple[Tensor, Tensor]:
    """Inputs z (b, m, n_local) and depths (b,) of some samples."""
    local = data.local[index, : _points(data, index)]
    return model.normalised(local), model.normalised_depth(data.depth[index])


def _unfamiliarity(model: ForceModel, samples: Samples) -> tuple[Tensor, Tensor]:
    """See `ForceTask.unfamiliarity`."""
    data, distance, ratio = samples.data, list[Tensor](), list[Tensor]()
    for index in samples.batches:
        force, correction = _forces(data, index), _correction(model, data, index)
        distance.append(model.confidence.distance(contact_measures(*_normalised(model, data, index), force)))
        ratio.append(squared_ratio(force, correction).sqrt())
    bearing = samples.bearing
    return torch.cat(distance)[bearing], torch.cat(ratio)[bearing]


def _quadratic(samples: Samples, phi: Tensor, index: Tensor, volume_only: bool) -> Tensor:
    """|G^T phi|^2 (b,) of forces on contact points and around them (b, m, 2 dim)."""
    data, m = samples.data, phi.shape[1]
    blocks = samples.volume_blocks if volume_only else samples.blocks
    n = int(data.n_loads[index].max())
    points, nodes = (index, slice(m)), (index, slice(n))
    forces = on_loads(
        phi, data.corners[points], data.shares[points], data.anchors[nodes], data.anchor_shares[nodes], n
    )
    return quadratic_form((blocks[k] for k in index.tolist()), forces)


def _squared_error(samples: Samples, phi: Tensor, index: Tensor, volume_only: bool) -> Tensor:
    """|G^T phi - w|^2 (b,)."""
    data, m = samples.data, phi.shape[1]
    h, c = (data.volume_h, data.volume_squared) if volume_only else (data.h, data.squared)
    quadratic = _quadratic(samples, phi, index, volume_only)
    return quadratic - 2.0 * (phi * h[index, :m]).sum((1, 2)) + c[index]
