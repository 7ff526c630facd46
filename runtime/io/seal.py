"""Seals: checksums of every byte of a file, in a trailer after its content.

    content | table: CRC-32 of each block of the content, uint32 | footer: the table's place and checksums

CRC-32 finds every error that lies within 32 bits, so one altered byte for certain, and others but for one in
2^32. It takes a third of a second a GB (zlib; SHA-256 three times as long), less than it takes to read the
file from most disks, so a file is examined whole before anything of it is used: once in a process, unless
it changes. HDF5 looks no further than the end that its own header states, so all its tools open sealed files;
a program that writes into one loses or breaks the seal.
"""

from __future__ import annotations

import os
import struct
import time
import zlib
from dataclasses import dataclass
from io import BufferedIOBase
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

BLOCK = 1 << 16  # bytes: the resolution at which damage is located
_PIECE = 64 * BLOCK  # bytes read at a time
_MAGIC = b"softprint seal 1"
_FOOTER = struct.Struct("<QI16s")  # length of the content, CRC-32 of the table, magic; its own CRC-32 follows
_CRC = struct.Struct("<I")
_FOOTER_BYTES = _FOOTER.size + _CRC.size
_SETTLED = 2.0  # s: a file changed within the clock's resolution may change again with the same time stamp

Table = NDArray[np.uint32]
_Identity = tuple[int, int, int, int, int]
_verified: dict[Path, _Identity] = {}


class Unsealed(Exception):
    """The file does not end in a seal."""


@dataclass(frozen=True)
class Damage:
    """Bytes ``start`` to ``stop`` (exclusive) do not match their checksum in the seal."""

    start: int
    stop: int

    def __str__(self) -> str:
        return f"{self.start} to {self.stop - 1}"


def checksums(file: BufferedIOBase, length: int) -> Table:
    """CRC-32 of each block of the next ``length`` bytes, or fewer if the file ends before."""
    found: list[int] = []
    piece = memoryview(bytearray(min(_PIECE, length)))
    while length > 0 and (count := file.readinto(piece[: min(len(piece), length)])):
        found += (zlib.crc32(piece[start : min(start + BLOCK, count)]) for start in range(0, count, BLOCK))
        length -= count
    return np.array(found, dtype="<u4")


def seal(path: Path) -> None:
    """Append the seal to a complete file."""
    with path.open("r+b") as file:
        length = os.fstat(file.fileno()).st_size
        table = checksums(file, length).tobytes()
        footer = _FOOTER.pack(length, zlib.crc32(table), _MAGIC)
        file.seek(length)
        file.write(table + footer + _CRC.pack(zlib.crc32(footer)))


def is_verified(path: Path) -> bool:
    """Whether this process has verified the file, and it has not changed since. Raises OSError."""
    return _verified.get(path) == _identity(os.stat(path))


def damage(path: Path) -> list[Damage]:
    """The altered blocks of a sealed file, with neighbours joined. Raises Unsealed, OSError."""
    with path.open("rb") as file:
        identity = _identity(os.fstat(file.fileno()))
        if _verified.get(path) == identity:
            return []
        length, table_crc = _read_footer(file)
        file.seek(0)
        found = checksums(file, length)
        table = file.read()[:-_FOOTER_BYTES]
        if zlib.crc32(table) != table_crc:
            return [Damage(length, length + len(table))]
        bad = np.flatnonzero(found != np.frombuffer(table, dtype="<u4"))
        damaged = [
            Damage(int(run[0]) * BLOCK, min(int(run[-1] + 1) * BLOCK, length))
            for _, group in groupby(enumerate(bad), key=lambda pair: pair[1] - pair[0])
            for run in [[number for _, number in group]]
        ]
        if (
            not damaged
            and _identity(os.fstat(file.fileno())) == identity
            and time.time() - max(identity[3:]) / 1e9 > _SETTLED
        ):
            _verified[path] = identity
        return damaged


def _identity(found: os.stat_result) -> _Identity:
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns


def _read_footer(file: BufferedIOBase) -> tuple[int, int]:
    """Length of the content, and CRC-32 of the table."""
    size = os.fstat(file.fileno()).st_size
    file.seek(max(0, size - _FOOTER_BYTES))
    end = file.read(_FOOTER_BYTES)
    if len(end) < _FOOTER_BYTES or _CRC.unpack(end[-_CRC.size :])[0] != zlib.crc32(end[: -_CRC.size]):
        raise Unsealed
    length, table_crc, magic = _FOOTER.unpack(end[: -_CRC.size])
    if magic != _MAGIC or length + 4 * -(-length // BLOCK) + _FOOTER_BYTES != size:
        raise Unsealed
    return length, table_crc
