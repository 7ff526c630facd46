"""Checkpoints of a training run: safetensors with a JSON header, replaced atomically, never pickled.

They hold the weights, the best weights so far, Adam's moments and the curves. Batches are drawn from (seed,
step), so no state of a random generator needs keeping: a run that was killed and resumed equals one that was
not. A digest tells whether anything was altered: safetensors itself keeps no checksum.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from runtime.errors import SoftprintError
from runtime.files import atomic_path, content_hash

KIND, VERSION = "training_checkpoint", 2


@dataclass(frozen=True)
class Checkpoint:
    """fingerprint: what the run is (data, options, settings, seed), as text; step: optimiser steps done;
    history: the curves so far; tensors: named weights and moments."""

    fingerprint: str
    step: int
    history: list[dict[str, float]]
    tensors: dict[str, Tensor]


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint, replacing the one before only when whole."""
    header = {
        "softprint_kind": KIND,
        "softprint_version": str(VERSION),
        "fingerprint": checkpoint.fingerprint,
        "step": str(checkpoint.step),
        "history": json.dumps(checkpoint.history),
    }
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in checkpoint.tensors.items()}
    header["digest"] = _digest(header, tensors)
    with atomic_path(path) as temporary:
        save_file(tensors, temporary, metadata=header)


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint. Raises SoftprintError where the file is damaged or foreign."""
    try:
        with safe_open(path, framework="pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
    except (SafetensorError, OSError) as error:
        raise SoftprintError(
            f"{path}: not a readable checkpoint ({error}): remove it and train again"
        ) from error
    if (header.get("softprint_kind"), header.get("softprint_version")) != (KIND, str(VERSION)):
        raise SoftprintError(
            f"{path}: not a training checkpoint of version {VERSION}: remove it and train again"
        )
    recorded = header.pop("digest", "")
    if recorded != _digest(header, tensors):
        raise SoftprintError(
            f"{path}: the checkpoint was altered or damaged (its digest does not match): remove it and train again"
        )
    return Checkpoint(header["fingerprint"], int(header["step"]), json.loads(header["history"]), tensors)


def _digest(header: Mapping[str, str], tensors: Mapping[str, Tensor]) -> str:
    return content_hash({**header, **{f"tensor {name}": tensor.numpy() for name, tensor in tensors.items()}})


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
    """Put the tensors of :func:`pack` back into model and optimiser; returns the best weights."""
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
