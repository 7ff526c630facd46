"""The first bytes and the metadata of a file, read before the rest of it."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import read_text

HDF5 = b"\x89HDF\r\n\x1a\n"
HEAD_BYTES = 4096
LARGEST_HEADER = 100_000_000  # bytes: safetensors' own limit
LARGEST_TEXT = 256_000_000  # bytes of JSON that are read to find its kind


@dataclass(frozen=True)
class FileHead:
    """start: the first bytes; marks: the metadata, such as `softprint_kind`; h5: names of the top-level groups and
    datasets of an HDF5 file; keys: the top-level keys of a JSON object."""

    path: Path
    start: bytes
    suffix: str
    marks: dict[str, Any] = field(default_factory=dict)
    h5: frozenset[str] | None = None
    keys: frozenset[str] = frozenset()

    @property
    def kind(self) -> str:
        """`softprint_kind` in its metadata, "" if it has none."""
        return str(self.marks.get("softprint_kind", ""))


def read_head(path: Path) -> FileHead:
    """Read the head of a file. Raises SoftprintError if it is missing, a folder, empty or unreadable; damage in the
    rest of it is found by its reader."""
    if path.is_dir():
        raise SoftprintError(f"{path}: is a folder; name a file in it")
    try:
        with path.open("rb") as file:
            start = file.read(HEAD_BYTES)
    except FileNotFoundError as error:
        raise SoftprintError(f"{path}: there is no such file") from error
    except OSError as error:
        raise SoftprintError(f"{path}: cannot be read: {error.strerror}") from error
    if not start:
        raise SoftprintError(f"{path}: is empty: make the file again")
    suffix = path.suffix.lower()
    if start.startswith(HDF5):
        return _hdf5_head(path, start, suffix)
    if suffix == ".safetensors":
        return FileHead(path, start, suffix, _safetensors_marks(path))
    if suffix == ".json":
        return FileHead(path, start, suffix, keys=_json_keys(path))
    return FileHead(path, start, suffix)


def _hdf5_head(path: Path, start: bytes, suffix: str) -> FileHead:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            marks = {"softprint_kind": ""}
            if "softprint_kind" in file.attrs:
                marks["softprint_kind"] = read_text(file.attrs, "softprint_kind")
            return FileHead(path, start, suffix, marks, frozenset(file))
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise SoftprintError(f"{path}: an HDF5 file that is truncated or damaged: make it again") from error


def _safetensors_marks(path: Path) -> dict[str, Any]:
    """The metadata of a safetensors file: 8 bytes of length, then JSON."""
    try:
        with path.open("rb") as file:
            length = int.from_bytes(file.read(8), "little")
            if length > min(LARGEST_HEADER, path.stat().st_size):
                raise ValueError("the header is longer than the file")
            metadata = json.loads(file.read(length)).get("__metadata__", {})
            return {str(name): value for name, value in metadata.items()}
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise SoftprintError(
            f"{path}: not a readable safetensors file (truncated or damaged): make it again"
        ) from error


def _json_keys(path: Path) -> frozenset[str]:
    if path.stat().st_size > LARGEST_TEXT:
        raise SoftprintError(f"{path}: is too large for a JSON file of Softprint")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise SoftprintError(f"{path}: not readable as JSON (truncated or damaged): make it again") from error
    return frozenset(map(str, content)) if isinstance(content, dict) else frozenset()
