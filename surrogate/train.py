"""Training of one contact model: Adam with a cosine schedule, the best weights on held-out states kept.

Deterministic for a seed: the batch of step i is drawn from (seed, i), the initial weights from the seed.
"""

from __future__ import annotations

import copy
import json
import logging
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from runtime.corrections.model import ContactModel, ModelOptions
from surrogate.checkpoints import Checkpoint, load_checkpoint, pack, save_checkpoint, unpack
from surrogate.dataset import ContactDataset
from surrogate.losses import FieldError, contact_loss, field_error

ProgressUpdate = Callable[[int, str], None]

log = logging.getLogger(__name__)

# Samples from which the normalisation of inputs and outputs is measured.
_NORMALISATION_SAMPLES = 512


@dataclass(frozen=True)
class TrainingSettings:
    """steps: of the optimiser; batch: samples a step; learning_rate: at the start, falling to zero along a cosine;
    weight_decay: decoupled (AdamW); edge_weight: of the edge term of the loss; validations: how often along the run
    the held-out error is measured and a checkpoint written; seed."""

    steps: int
    batch: int
    learning_rate: float
    weight_decay: float
    edge_weight: float
    validations: int
    seed: int


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """model: with its best weights; held_out: their error on the validation states; history: the curves, one entry a
    validation (step, loss, learning_rate, validation_rms)."""

    model: ContactModel
    held_out: FieldError
    history: list[dict[str, float]]


def fresh_model(options: ModelOptions, data: ContactDataset, seed: int) -> ContactModel:
    """Initial weights from the seed, normalisation from the data."""
    dim, n_rows = data.rows.shape[-1], data.rows.shape[1]
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = ContactModel(options, dim, n_rows)
    model.to(data.rows.device)
    chosen = np.random.default_rng(seed).permutation(len(data))[:_NORMALISATION_SAMPLES]
    index = torch.from_numpy(chosen).to(data.rows.device)
    batch = data.batch(index)
    local = model.encoding.encode(batch.state).flatten(0, 1)
    model.normalise(local, data.shared, data.depth, batch.target.flatten(0, 1))
    return model


def train(
    options: ModelOptions,
    data: ContactDataset,
    validation: ContactDataset,
    settings: TrainingSettings,
    checkpoint: Path | None = None,
    data_name: str = "",
    progress: ProgressUpdate | None = None,
) -> TrainingResult:
    """Train a model on `data`, judged on `validation`; both on one device.

    checkpoint: where to keep the run; one found there is resumed if it is of the same run (options, settings and
    `data_name`). progress: called with the number of steps done since the last call and a few words.
    """
    fingerprint = json.dumps([options.to_json(), asdict(settings), data_name, len(data)], sort_keys=True)
    model = fresh_model(options, data, settings.seed)
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
        index = torch.from_numpy(rng.integers(len(data), size=settings.batch)).to(data.rows.device)
        running.append(_step(model, optimiser, rate, lambda i=index: contact_loss(model, data.batch(i), settings.edge_weight)))
        if progress is not None:
            progress(1, f"held-out error {lowest:.3f}" if history else "")
        if step + 1 in marks:
            error = field_error(model, validation)
            loss = float(torch.stack(running).mean())
            running.clear()
            history.append(
                {"step": step + 1, "loss": loss, "learning_rate": rate, "validation_rms": error.rms}
            )
            if error.rms < lowest:
                lowest, best = error.rms, copy.deepcopy(model.state_dict())
            if checkpoint is not None:
                save_checkpoint(checkpoint, Checkpoint(fingerprint, step + 1, history, pack(model, best, optimiser)))
    model.load_state_dict(best)
    return TrainingResult(model, field_error(model, validation), history)


def _step(
    model: ContactModel, optimiser: torch.optim.Optimizer, rate: float, loss_of: Callable[[], Tensor]
) -> Tensor:
    """One step of the optimiser; returns the loss."""
    for group in optimiser.param_groups:
        group["lr"] = rate
    optimiser.zero_grad()
    loss = loss_of()
    loss.backward()
    # Rare samples at the edge of stability have huge residuals; one of them must not throw the weights.
    torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
    optimiser.step()
    return loss.detach()


def _resumable(path: Path | None, fingerprint: str) -> Checkpoint | None:
    if path is None or not path.exists():
        return None
    found = load_checkpoint(path)
    if found.fingerprint != fingerprint:
        log.info("%s: is of another training run; starting afresh", path)
        return None
    return found
