"""Learned contact forces from all samples, of which as much is kept as networks on parts of them bear out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.learned.force.confidence import FAR, NEAR
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.joint_settling import JointSettling
from softprint.surrogate.data.folds import Fold
from softprint.surrogate.force.data import ForceData
from softprint.surrogate.force.kept_part import kept_part
from softprint.surrogate.force.loss import ForceMetric
from softprint.surrogate.force.task import SHALLOW, ForceTask, Gains, Samples
from softprint.surrogate.learning_task import HeldOutError

# What M0 may be: beyond a share of the contacts to judge by, and so many times that. By how much the error has to fall
# for contacts farther from training to be trusted.
_LIMITS = (NEAR, 1.0), (FAR, 1.0), (FAR, 1.5)
_WORTH = 0.02
_NOTHING = 1e-30


class CrossedForceTask:
    """A `CrossedTask` of samples and their folds, whose rows are positions in `data.sample`."""

    def __init__(
        self,
        options: ForceModelOptions,
        metric: ForceMetric,
        data: ForceData,
        folds: Sequence[Fold],
        n_rows: int,
        notes: dict[str, Any] | None = None,
        settling: JointSettling | None = None,
    ) -> None:
        samples = Samples.of(metric, data)
        self.notes = dict(notes or {})
        self.whole = ForceTask(options, samples, None, n_rows, settling=settling)
        self.folds = [
            ForceTask(options, samples.take(_rows(fold.learn)), samples.take(_rows(fold.judge)), n_rows)
            for fold in folds
        ]

    def conclude(self, model: ForceModel, by_fold: Sequence[ForceModel]) -> HeldOutError:
        """Set the confidence factor of the model from contacts that the networks of the folds were not trained on, keep
        the part of it that they bear out, and return what is left on these contacts then."""
        before = [_sums(fold.gains(own)) for fold, own in zip(self.folds, by_fold, strict=True)]
        if not any(own[2].any() for own in before):  # nothing was learned
            return _error(before, 0.0)
        seen = [fold.unfamiliarity(own) for fold, own in zip(self.folds, by_fold, strict=True)]
        distance, ratio = (torch.cat(column) for column in zip(*seen, strict=True))
        found, chosen = None, _LIMITS[0]
        for limits in _LIMITS if len(ratio) else _LIMITS[:1]:
            _limit(by_fold, distance, ratio, limits)
            judged = self._judged(by_fold)
            if found is None or judged.error.rms < (1.0 - _WORTH) * found.error.rms:
                found, chosen = judged, limits
        assert found is not None
        learned = model.confidence.ceiling.clone()
        _limit([model], distance, ratio, chosen)
        # Networks of parts have fewer steps, and smaller corrections.
        model.confidence.ceiling.copy_(torch.maximum(model.confidence.ceiling, learned))
        model.keep(found.part)
        self.notes["kept"] = {"part": found.part, "best": found.best, "folds": len(self.folds)}
        return found.error

    def _judged(self, by_fold: Sequence[ForceModel]) -> _Judged:
        """With the limits of confidence that the networks of the folds have."""
        gains = [_sums(fold.gains(own)) for fold, own in zip(self.folds, by_fold, strict=True)]
        cross, square = _relative(gains)
        part = kept_part(cross, square)
        return _Judged(part, float(cross.sum() / max(square.sum(), _NOTHING)), _error(gains, part))


class _Judged(NamedTuple):
    """part: what is kept; best: the share with the least error; error: what is left."""

    part: float
    best: float
    error: HeldOutError


def _limit(
    models: Sequence[ForceModel], distance: Tensor, ratio: Tensor, limits: tuple[float, float]
) -> None:
    """Set the limits of confidence of some networks from M (s,) and rho (s,) of contacts to judge by, if any."""
    for model in models if len(ratio) else ():
        model.confidence.limit(distance, ratio, *limits)


def _sums(gains: Gains) -> tuple[Array, ...]:
    return tuple(part.cpu().double().numpy() for part in gains)


def _relative(gains: Sequence[tuple[Array, ...]]) -> tuple[Array, Array]:
    """The sums over cross and square (K,) of each fold, with the weights of the loss: contacts on a thin limb, which
    displace much, would outweigh all others, and a motion is judged by its own displacement."""
    mean = np.concatenate([own[3] for own in gains]).mean()
    weights = [1.0 / (own[3] + SHALLOW * mean) for own in gains]
    cross, square = (
        np.array([weight @ own[k] for weight, own in zip(weights, gains, strict=True)]) for k in (1, 2)
    )
    return cross, square


def _error(gains: Sequence[tuple[Array, ...]], part: float) -> HeldOutError:
    """With a part of the correction."""
    missed, cross, square, whole = (np.concatenate(column) for column in zip(*gains, strict=True))
    return HeldOutError.of(missed - 2.0 * part * cross + part**2 * square, whole)


def _rows(part: IntArray) -> Tensor:
    return torch.from_numpy(part)
