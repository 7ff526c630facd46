"""Files of named PyTorch tensors: those of `tensor_file.py`, which alone does not need PyTorch."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import torch
from numpy.typing import NDArray
from torch import Tensor

from softprint.runtime.io import tensor_file

Header = TypeVar("Header")


def save_tensors(
    path: Path, kind: str, version: int, texts: Mapping[str, str], tensors: Mapping[str, Tensor]
) -> None:
    """Write tensors and texts, see `tensor_file.save_arrays`."""
    arrays = {name: tensor.detach().cpu().numpy() for name, tensor in tensors.items()}
    tensor_file.save_arrays(path, kind, version, texts, arrays)


def load_tensors(
    path: Path, kind: str, version: int, remedy: str
) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Texts and tensors of a file, see `tensor_file.load_arrays`."""
    texts, arrays = tensor_file.load_arrays(path, kind, version, remedy)
    return texts, _as_tensors(arrays)


def load_with_header(
    header: type[Header], path: Path, kind: str, version: int, remedy: str
) -> tuple[Header, dict[str, Tensor]]:
    """Header and tensors of a file, see `tensor_file.load_with_header`."""
    found, arrays = tensor_file.load_with_header(header, path, kind, version, remedy)
    return found, _as_tensors(arrays)


def _as_tensors(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Tensor]:
    return {name: torch.from_numpy(array) for name, array in arrays.items()}
