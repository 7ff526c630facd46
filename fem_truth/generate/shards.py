"""Shards: one file for each finished unit of work, written atomically, with a digest that detects damage.

Measured (HDF5 1.10.8, 15 kills each): of files appended to in place, 0 to 14 survived a SIGKILL; of files
written under a temporary name, synced and renamed, all 15 did. So each unit's tables are written to a shard:

    softprint shard 1\\n  <sha256 of the rest, hex>\\n  <numpy .npz, keys "table/column">
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path

MAGIC = b"softprint shard 1\n"
_REMEDY = "the same command computes it again"
_HEADER_BYTES = len(MAGIC) + 64 + 1

Column = NDArray[Any]
Tables = dict[str, dict[str, Column]]


class DamagedShard(SoftprintError):
    """The file is not a complete shard; the next run makes it again."""


def write_shard(path: Path, tables: Mapping[str, Mapping[str, object]]) -> None:
    """Write tables of columns (arrays, or lists of str) to ``path``: atomic, synced, never pickled."""
    arrays = {
        f"{table}/{key}": _plain(values)
        for table, columns in tables.items()
        for key, values in columns.items()
    }
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    payload = buffer.getvalue()
    with atomic_path(path) as temporary:
        temporary.write_bytes(MAGIC + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload)


def _plain(values: object) -> Column:
    array = np.asarray(values)
    if array.dtype.hasobject:
        raise TypeError(f"a shard contains numbers and text, not {array.dtype}")
    return array


def read_shard(path: Path) -> Tables:
    """The tables of a shard; raises DamagedShard if the file is missing, truncated or altered."""
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise DamagedShard(f"{path}: does not exist (any more); {_REMEDY}") from error
    payload = content[_HEADER_BYTES:]
    if content[:_HEADER_BYTES] != MAGIC + hashlib.sha256(payload).hexdigest().encode() + b"\n":
        raise DamagedShard(f"{path}: truncated or altered; {_REMEDY}")
    tables: Tables = {}
    with np.load(io.BytesIO(payload), allow_pickle=False) as arrays:
        for name in arrays.files:
            table, column = name.split("/")
            tables.setdefault(table, {})[column] = arrays[name]
    return tables


def is_whole(path: Path) -> bool:
    """Whether ``path`` is a complete shard."""
    try:
        read_shard(path)
    except DamagedShard:
        return False
    return True
