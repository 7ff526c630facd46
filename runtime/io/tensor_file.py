"""Files of named arrays: safetensors with checksums of every byte in its metadata. Never pickle.

safetensors has no checksums, and allows no bytes after its tensors. So the checksums of the file's blocks
(:mod:`runtime.io.seal`) are a metadata text, computed with this text filled with zeros. Any tool reads such a file, and
every altered byte is detected, in tensors, in texts, and between them. `torch_file.py` has the same for PyTorch.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path
from softprint.runtime.io.seal import BLOCK, checksums

Header = TypeVar("Header")

_DIGITS = 8  # of a checksum
_BEGINS = b'"checksums":"'
_LENGTH_BYTES = 8  # safetensors: length of the header, header (JSON), tensors


def save_arrays(
    path: Path, kind: str, version: int, texts: Mapping[str, str], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write arrays and texts, atomically, with the permissions of the user's umask."""
    texts = {"softprint_kind": kind, "softprint_version": str(version), **texts}
    bare = {name: np.require(array, requirements="C") for name, array in arrays.items()}
    blocks = len(save(bare, metadata=texts)) // BLOCK + 1
    blocks += 1 + blocks * _DIGITS // BLOCK  # for the checksums themselves
    content = save(bare, metadata={**texts, "checksums": "0" * (_DIGITS * blocks)})
    start = content.index(_BEGINS) + len(_BEGINS)
    stop = start + _DIGITS * blocks
    text = _checksums(content, start, stop)
    with atomic_path(path) as temporary:
        # Not `save_file`, whose files only their owner may read.
        temporary.write_bytes(content[:start] + text + content[stop:])


def load_arrays(
    path: Path, kind: str, version: int, remedy: str
) -> tuple[dict[str, str], dict[str, NDArray[Any]]]:
    """Texts and arrays of a file. Raises SoftprintError, which ends in the remedy, if it is missing, damaged, of
    another kind or of another version."""
    what = kind.replace("_", " ")
    try:
        content = path.read_bytes()
        texts = _texts(content)
    except FileNotFoundError as error:
        raise SoftprintError(f"{path}: there is no such {what} file: {remedy}") from error
    except (OSError, ValueError, RecursionError, MemoryError) as error:
        raise SoftprintError(
            f"{path}: not a readable {what} file (truncated, damaged, or not safetensors): {remedy}"
        ) from error
    sealed = _BEGINS in content
    if sealed:
        _refuse_damage(path, content, what, remedy)
    if texts.get("softprint_kind") != kind:
        raise SoftprintError(f"{path}: a safetensors file, but no {what} of Softprint's: {remedy}")
    if texts.get("softprint_version") != str(version):
        raise SoftprintError(
            f"{path}: {what} of version {texts.get('softprint_version')}, but this program reads version "
            f"{version}: {remedy}"
        )
    if not sealed:
        raise SoftprintError(f"{path}: the {what} file is damaged (its checksums are gone): {remedy}")
    try:
        arrays = load(content)
    except (SafetensorError, ValueError, KeyError, RuntimeError, MemoryError) as error:
        raise SoftprintError(f"{path}: not a readable {what} file ({error}): {remedy}") from error
    return texts, arrays


def load_with_header(
    header: type[Header], path: Path, kind: str, version: int, remedy: str
) -> tuple[Header, dict[str, NDArray[Any]]]:
    """The text `header` of a file, a JSON object with the fields of a dataclass, and its arrays; errors as
    `load_arrays`."""
    texts, arrays = load_arrays(path, kind, version, remedy)
    try:
        return header(**json.loads(texts["header"])), arrays
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise SoftprintError(f"{path}: the header is incomplete ({error}): {remedy}") from error


def _texts(content: bytes) -> dict[str, str]:
    """The metadata texts. Raises ValueError if there are none."""
    texts = _header(content).get("__metadata__", {})
    if not isinstance(texts, dict) or not all(isinstance(value, str) for value in texts.values()):
        raise ValueError("no texts")
    return texts


def _header(content: bytes) -> dict[str, object]:
    length = int.from_bytes(content[:_LENGTH_BYTES], "little")
    if not 2 <= length <= len(content) - _LENGTH_BYTES:
        raise ValueError("no header")
    header = json.loads(content[_LENGTH_BYTES : _LENGTH_BYTES + length])
    if not isinstance(header, dict):
        raise ValueError("no header")
    return header


def _checksums(content: bytes, start: int, stop: int) -> bytes:
    """Checksums of all blocks as hexadecimal digits, with bytes start to stop taken as zeros; padded with zeros."""
    zeroed = io.BytesIO(content)
    zeroed.getbuffer()[start:stop] = b"0" * (stop - start)
    found = checksums(zeroed, len(content))
    return b"".join(b"%08x" % crc for crc in found.tolist()).ljust(stop - start, b"0")


def _refuse_damage(path: Path, content: bytes, what: str, remedy: str) -> None:
    start = content.index(_BEGINS) + len(_BEGINS)
    stop = content.find(b'"', start)
    if stop - start < _DIGITS * (len(content) // BLOCK + 1):
        raise SoftprintError(f"{path}: the {what} file is damaged (it has too few checksums): {remedy}")
    kept, found = content[start:stop], _checksums(content, start, stop)
    if kept == found:
        return
    differs = np.frombuffer(kept, np.uint8) != np.frombuffer(found, np.uint8)
    block = int(np.flatnonzero(differs)[0]) // _DIGITS
    first, last = block * BLOCK, min((block + 1) * BLOCK, len(content)) - 1
    raise SoftprintError(
        f"{path}: the {what} file is damaged: bytes within {first} to {last} were altered "
        f"({_in_bytes(content, first, last)}): {remedy}"
    )


def _in_bytes(content: bytes, first: int, last: int) -> str:
    """The content of a range of bytes, according to the header."""
    header = _header(content)
    begin = _LENGTH_BYTES + int.from_bytes(content[:_LENGTH_BYTES], "little")
    named = ["its header"] if first < begin else []
    for name, entry in header.items():
        offsets = entry.get("data_offsets") if isinstance(entry, dict) else None
        if (
            name != "__metadata__"
            and isinstance(offsets, list)
            and len(offsets) == 2
            and all(isinstance(offset, int) for offset in offsets)
            and begin + offsets[0] <= last
            and begin + offsets[1] > first
        ):
            named.append(name)
    return ", ".join(named[:3]) + (" and more" if len(named) > 3 else "")
