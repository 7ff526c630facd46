"""What `softprint inspect` prints for a training checkpoint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary, byte_size
from softprint.surrogate.checkpoints import KIND as CHECKPOINT
from softprint.surrogate.checkpoints import load_checkpoint


def recognise(head: FileHead) -> bool:
    return head.suffix == ".safetensors" and head.kind == CHECKPOINT


def summarise(path: Path, part: Part) -> Summary:
    """Reads all tensors and checks them against the digest."""
    checkpoint = load_checkpoint(path)
    model = [tensor for name, tensor in checkpoint.tensors.items() if name.startswith("model.")]
    facts: dict[str, Any] = {
        "steps done": checkpoint.step,
        "weights": sum(tensor.numel() for tensor in model),
        "memory": byte_size(sum(tensor.nbytes for tensor in checkpoint.tensors.values())),
        "validations": len(checkpoint.history),
    }
    sections: dict[str, dict[str, Any]] = {"checkpoint": facts}
    if checkpoint.history:
        sections["latest"] = dict(checkpoint.history[-1])
    sections["run"] = {"fingerprint": checkpoint.fingerprint}
    return Summary(path, "a checkpoint of an unfinished training run", sections)


KIND = Kind(recognise, summarise)
