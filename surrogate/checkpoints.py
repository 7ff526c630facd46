"""Checkpoints of a training run: safetensors with a JSON header, replaced atomically, never pickled.

They hold the weights, the best weights so far, Adam's moments and the training curves. Batches are drawn from
(seed, step), so no random generator state is saved: a run that is killed and resumed gives the same result as an
uninterrupted one.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.torch_file import load_tensors, save_tensors

KIND, VERSION = "training_checkpoint", 3
REMEDY = "remove it and train again"


@dataclass(frozen=True)
class Checkpoint:
    """fingerprint: data, options, settings and seed of the run, as text; step: optimiser steps done; history: the
    training curves so far; tensors: named weights and moments."""

    fingerprint: str
    step: int
    history: list[dict[str, float]]
    tensors: dict[str, Tensor]


@dataclass(frozen=True)
class Checkpoints:
    """The checkpoints of the parts of a training, beside the correction (`correction`) that comes of it."""

    correction: Path

    def path(self, part: str) -> Path:
        """Of one part; that without a name is of a training without parts."""
        words = "".join(f".{word}" for word in part.split())
        return self.correction.with_suffix(f"{words}.checkpoint")

    def remove(self) -> None:
        """Remove those of all parts; not those of models whose names begin with the same words."""
        own = re.compile(
            rf"{re.escape(self.correction.stem)}(\.part\.\d+\.of\.\d+|\.all\.samples)?\.checkpoint"
        )
        for path in self.correction.parent.glob("*.checkpoint"):
            if own.fullmatch(path.name):
                path.unlink(missing_ok=True)


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint; the previous one is replaced atomically."""
    texts = {
        "fingerprint": checkpoint.fingerprint,
        "step": str(checkpoint.step),
        "history": json.dumps(checkpoint.history),
    }
    save_tensors(path, KIND, VERSION, texts, checkpoint.tensors)


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint. Raises SoftprintError if the file is damaged or not a checkpoint."""
    texts, tensors = load_tensors(path, KIND, VERSION, REMEDY)
    try:
        return Checkpoint(texts["fingerprint"], int(texts["step"]), json.loads(texts["history"]), tensors)
    except (KeyError, ValueError, RecursionError) as error:
        raise SoftprintError(f"{path}: the checkpoint is incomplete ({error}): {REMEDY}") from error


def pack(
    model: torch.nn.Module, best: dict[str, Tensor], optimiser: torch.optim.Optimizer
) -> dict[str, Tensor]:
    """Weights, best weights and Adam's moments under flat names."""
    tensors = {f"model.{name}": tensor.clone() for name, tensor in model.state_dict().items()}
    tensors |= {f"best.{name}": tensor for name, tensor in best.items()}
    for index, state in optimiser.state_dict()["state"].items():
        tensors |= {f"adam.{index}.{name}": tensor.clone() for name, tensor in state.items()}
    return tensors


def unpack(
    tensors: dict[str, Tensor], model: torch.nn.Module, optimiser: torch.optim.Optimizer
) -> dict[str, Tensor]:
    """Restore model and optimiser from the tensors of :func:`pack`; returns the best weights."""
    groups: dict[str, dict[str, Tensor]] = {"model": {}, "best": {}, "adam": {}}
    for name, tensor in tensors.items():
        group, rest = name.split(".", 1)
        groups[group][rest] = tensor
    model.load_state_dict(groups["model"])
    moments: dict[int, dict[str, Tensor]] = {}
    for name, tensor in groups["adam"].items():
        index, key = name.split(".")
        moments.setdefault(int(index), {})[key] = tensor
    optimiser.load_state_dict({**optimiser.state_dict(), "state": moments})
    return groups["best"]
