"""Training of one contact model: Adam with a cosine schedule; the weights with the lowest held-out error are kept.

Deterministic for a given seed: the batch of step i is drawn from (seed, i), the initial weights from the seed.
"""

from __future__ import annotations

import copy
import json
import logging
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Generic

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.form import ModelT
from softprint.surrogate.checkpoints import Checkpoint, load_checkpoint, pack, save_checkpoint, unpack
from softprint.surrogate.learning_task import HeldOutError, LearningTask

ProgressUpdate = Callable[[int, str], None]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrainingSettings:
    """steps: optimiser steps; batch: samples per step; learning_rate: initial, decays to zero along a cosine;
    weight_decay: decoupled (AdamW); validations: how many times during the run the held-out error is measured and a
    checkpoint written; seed."""

    steps: int
    batch: int
    learning_rate: float
    weight_decay: float
    validations: int
    seed: int


@dataclass(frozen=True, eq=False)
class TrainingResult(Generic[ModelT]):
    """model: with its best weights; held_out: their error on the validation states; history: the training curves, one
    entry per validation (step, loss, learning_rate, validation_rms)."""

    model: ModelT
    held_out: HeldOutError
    history: list[dict[str, float]]


def train(
    task: LearningTask[ModelT],
    settings: TrainingSettings,
    checkpoint: Path | None = None,
    data_name: str = "",
    progress: ProgressUpdate | None = None,
    select: bool = True,
) -> TrainingResult[ModelT]:
    """Train a model of the task. select: keep the weights with the lowest held-out error; otherwise those of the end.

    checkpoint: path of the checkpoint; an existing one is resumed if it belongs to the same run (task, settings and
    `data_name`). progress: called with the number of steps done since the last call and a short note.
    """
    identity = [task.identity, asdict(settings), data_name, task.n_samples]
    fingerprint = json.dumps(identity, sort_keys=True)
    model = task.fresh_model(settings.seed)
    optimiser = torch.optim.AdamW(
        model.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
    )
    best, history, first = copy.deepcopy(model.state_dict()), [], 0
    found = _resumable(checkpoint, fingerprint)
    if found is not None:
        best, history, first = unpack(found.tensors, model, optimiser), found.history, found.step
    marks = {round(settings.steps * (k + 1) / settings.validations) for k in range(settings.validations)}
    lowest = min((entry["validation_rms"] for entry in history), default=math.inf)
    running: list[Tensor] = []
    if progress is not None and first:
        progress(first, "resumed")
    for step in range(first, settings.steps):
        rate = 0.5 * settings.learning_rate * (1.0 + math.cos(math.pi * step / settings.steps))
        rng = np.random.default_rng([settings.seed, step])
        index = torch.from_numpy(rng.integers(task.n_samples, size=settings.batch)).to(task.device)
        running.append(_step(task, model, optimiser, rate, index))
        if progress is not None:
            progress(1, f"held-out error {lowest:.3f}" if lowest < math.inf else "")
        if step + 1 in marks:
            error = task.held_out_error(model)
            loss = float(torch.stack(running).mean())
            running.clear()
            if not math.isfinite(loss + (error.rms if select else 0.0)):  # without held-out samples there is no error
                raise SoftprintError(
                    f"training has diverged: at step {step + 1} the loss is {loss} and the held-out error {error.rms}; "
                    f"take a smaller learning_rate than {settings.learning_rate:g}"
                )
            history.append(
                {"step": step + 1, "loss": loss, "learning_rate": rate, "validation_rms": error.rms}
            )
            if error.rms < lowest:
                lowest, best = error.rms, copy.deepcopy(model.state_dict())
            if checkpoint is not None:
                save_checkpoint(
                    checkpoint, Checkpoint(fingerprint, step + 1, history, pack(model, best, optimiser))
                )
    if select:
        model.load_state_dict(best)
    task.finish(model)
    return TrainingResult(model, task.held_out_error(model), history)


def _step(
    task: LearningTask[ModelT], model: ModelT, optimiser: torch.optim.Optimizer, rate: float, index: Tensor
) -> Tensor:
    """One step of the optimiser on samples `index`; returns the loss."""
    for group in optimiser.param_groups:
        group["lr"] = rate
    optimiser.zero_grad()
    loss = task.loss(model, index)
    loss.backward()
    # Rare samples at the edge of stability have huge residuals; clipping keeps one of them from ruining the weights.
    torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
    optimiser.step()
    return loss.detach()


def _resumable(path: Path | None, fingerprint: str) -> Checkpoint | None:
    if path is None or not path.exists():
        return None
    found = load_checkpoint(path)
    if found.fingerprint != fingerprint:
        log.info("%s: belongs to another training run; starting from the beginning", path)
        return None
    return found
