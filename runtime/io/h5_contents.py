"""Checks of an HDF5 file's structure before its data are read, and diagnosis of files without a valid seal.

HDF5 can point out of a file (external and soft links, external storage, virtual datasets), in circles (a group within
itself) and to Python objects, and can claim arrays of terabytes in a few bytes. Softprint files never do, so files that
do are refused.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.memory_bound import memory_bound

if TYPE_CHECKING:
    import h5py

# A dataset may take this much memory, regardless of the size of its file (texts compress a thousandfold) ...
_ROOM = 1 << 28  # bytes
# ... and this many times the size of its file, because numbers compress too.
_COMPRESSION = 16
_DEPTH = 8  # of nested groups; Softprint files have three levels
_PLAIN = set("iufbS")  # kinds of numpy types: integers, floats, booleans, text of fixed length
# A process that reads a file may take so many seconds, and longer for files that are read at this rate [bytes/s].
_PATIENCE, _SLOWEST = 20.0, 1e7

# Of a child process, because HDF5 may crash on damaged bytes: prints the kind of a file.
_PROBE = (
    "-c",
    """
import json, sys, h5py
with h5py.File(sys.argv[1], "r") as file:
    kind, version = (file.attrs.get(name) for name in ("softprint_kind", "softprint_version"))
    kind = kind.decode(errors="replace") if isinstance(kind, bytes) else kind
    print(json.dumps([None if kind is None else str(kind), -1 if version is None else int(version)]))
""",
)
_READ = ("-m", __name__)  # prints the names of unreadable datasets


def claims(path: Path) -> tuple[str | None, int] | None:
    """Kind and version that an HDF5 file states, read in a child process that may crash; None if unreadable."""
    said = _asked(_PROBE, path)
    if said is None:
        return None
    kind, version = json.loads(said)
    return kind, version


def unreadable_datasets(path: Path) -> list[str]:
    """Names of the datasets that HDF5 cannot read completely, by their own checksums. Read in a child process too: on
    an altered table of contents HDF5 may crash, or read without end."""
    said = _asked(_READ, path)
    return ["its table of contents"] if said is None else json.loads(said)


def _asked(reader: tuple[str, str], path: Path) -> str | None:
    """What a Python process that reads the file prints; None where it crashes, fails, or finds no end."""
    try:
        asked = subprocess.run(
            [sys.executable, *reader, str(path)],
            capture_output=True,
            text=True,
            timeout=_PATIENCE + path.stat().st_size / _SLOWEST,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return None
    return asked.stdout if asked.returncode == 0 else None


def refuse_tricks(file: h5py.File, source: Path) -> None:
    """Raise SoftprintError if an open file contains structures that Softprint files never have."""
    import h5py

    limit = _ROOM + _COMPRESSION * source.stat().st_size
    for name, item in _walk(file, source, "", 0):
        for attribute in item.attrs:
            kind = item.attrs.get_id(attribute).dtype.kind
            if kind not in _PLAIN:
                raise _refusal(source, f"{name}@{attribute}", "is neither a number nor text of fixed length")
        if not isinstance(item, h5py.Dataset):
            continue
        if item.dtype.kind not in _PLAIN:
            raise _refusal(source, name, "contains neither numbers nor text of fixed length")
        if item.is_virtual or item.external:
            raise _refusal(source, name, "stores its numbers in another file")
        if item.size is None or item.size * item.dtype.itemsize > limit:
            raise _refusal(source, name, f"claims {item.shape} values, more than such a file can contain")


def _walk(group: h5py.Group, source: Path, name: str, depth: int) -> Iterator[tuple[str, h5py.HLObject]]:
    import h5py

    if depth > _DEPTH:
        raise _refusal(source, name, "is nested in too many groups")
    yield name or "/", group
    for key in group:
        child = f"{name}/{key}"
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            raise _refusal(source, child, "points elsewhere")
        item = group[key]
        if isinstance(item, h5py.Group):
            yield from _walk(item, source, child, depth + 1)
        else:
            yield child, item


def _refusal(source: Path, name: str, trouble: str) -> SoftprintError:
    return SoftprintError(f"{source}: {name!r} {trouble}, unlike Softprint files: make it again")


def _unreadable(path: Path) -> list[str]:
    import h5py

    bad = []
    try:
        with memory_bound(path), h5py.File(path, "r") as file:
            for name, item in _walk(file, path, "", 0):
                if isinstance(item, h5py.Dataset) and not _is_readable(item):
                    bad.append(name)
    except (OSError, RuntimeError, ValueError, LookupError, MemoryError, SoftprintError):
        bad.append("its table of contents")
    return bad


def _is_readable(dataset: h5py.Dataset) -> bool:
    step = dataset.chunks[0] if dataset.chunks else max(1, len(dataset))
    try:
        for start in range(0, len(dataset), step):
            dataset[start : start + step]
    except (OSError, RuntimeError, ValueError, TypeError, MemoryError):
        return False
    return True


if __name__ == "__main__":
    print(json.dumps(_unreadable(Path(sys.argv[1]))))
