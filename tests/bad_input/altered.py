"""Files altered on purpose, with valid checksums, as a faulty program or an attacker might write them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import h5py
from safetensors import safe_open

from softprint.runtime.io.seal import seal
from softprint.runtime.io.torch_file import save_tensors


@contextmanager
def altered_h5(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file of ours open for changes, sealed afterwards."""
    with h5py.File(path, "r+") as file:  # HDF5 removes the old seal
        yield file
    seal(path)


def alter_tensors(path: Path, texts: Mapping[str, str], dropped: int = 0) -> None:
    """Rewrite one of our safetensors files with some texts changed and the first tensors left out."""
    with safe_open(path, framework="pt") as file:
        before = {name: text for name, text in file.metadata().items() if name != "checksums"}
        tensors = {name: file.get_tensor(name) for name in list(file.keys())[dropped:]}
    save_tensors(path, "", 0, {**before, **texts}, tensors)


def flipped(content: bytes, place: int, mask: int = 0x20) -> bytes:
    """The content with one byte altered."""
    return content[:place] + bytes([content[place] ^ mask]) + content[place + 1 :]
