"""Training on all samples, with networks on parts of them that say how far the result can be trusted.

No samples are put aside to choose the weights by, of which there would be few of one kind: a network is trained on all
of them to the end of the schedule, and its error is that of others, on samples that these were not trained on. The
others take a quarter of the steps each, so that all of them together cost as much as the one: their errors hardly fall
after that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from softprint.runtime.learned.form import ModelT
from softprint.surrogate.learning_task import CrossedTask, LearningTask
from softprint.surrogate.train import TrainingResult

#: Trains one network of a name for the bar and the checkpoint, for a share of the steps.
TrainOne = Callable[[str, LearningTask[ModelT], float], TrainingResult[ModelT]]

_SHARE_OF_STEPS = 0.25


def train_crossed(task: CrossedTask[ModelT], train_one: TrainOne[ModelT]) -> TrainingResult[ModelT]:
    """Train all networks of the task. The curves are of the folds."""
    n = len(task.folds)
    parts = [train_one(f"part {k + 1} of {n}", fold, _SHARE_OF_STEPS) for k, fold in enumerate(task.folds)]
    whole = train_one("all samples", task.whole, 1.0)
    error = task.conclude(whole.model, [part.model for part in parts])
    return TrainingResult(whole.model, error, _mean_curves([part.history for part in parts]))


def untrained(task: CrossedTask[ModelT], seed: int) -> TrainingResult[ModelT]:
    """Initial weights, with their error on the same samples."""
    model = task.whole.fresh_model(seed)
    return TrainingResult(model, task.conclude(model, [fold.fresh_model(seed) for fold in task.folds]), [])


def _mean_curves(curves: Sequence[Sequence[dict[str, float]]]) -> list[dict[str, float]]:
    """Point by point, the mean of what folds found."""
    return [
        {key: float(np.mean([entry[key] for entry in entries])) for key in entries[0]}
        for entries in zip(*curves, strict=True)
    ]
