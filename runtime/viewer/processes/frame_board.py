"""A board in shared memory on which one process pins the newest frame, and another takes it: neither waits.

There are three places. The writer fills the oldest and then announces it; a reader copies the announced one, and
copies again if the writer has come round to it meanwhile. Frames that nobody took in time are gone.
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass
from multiprocessing.reduction import ForkingPickler
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array

Floats = NDArray[np.float32]

_PLACES = 3
# Bytes for what goes with a frame: contact points, forces and poses, some ten kilobytes.
_ROOM = 1 << 20


@dataclass(frozen=True, eq=False)
class Picture:
    """A frame as drawn: positions (n, 3) [m], values (n,), whatever goes with them; number: counts from 1."""

    number: int
    vertices: Floats
    values: Floats
    meta: Any


class FrameBoard:
    """For frames of n vertices. To be made before the processes that share it are forked."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._each = 16 * n + _ROOM
        self._memory = mmap.mmap(-1, 64 + _PLACES * self._each)
        # The number of the newest frame, and of painters' finished orders (`painting_process.py`).
        self._heads: Array = np.frombuffer(self._memory, np.int64, 8)

    def publish(self, vertices: Floats, values: Floats, meta: Any) -> None:
        """Pin a frame. One process at a time may do so."""
        # As a pipe between processes does it: this memory has no name, and nobody else can write to it.
        packed = bytes(ForkingPickler.dumps(meta))
        if len(packed) > _ROOM - 8:
            raise ValueError(f"{len(packed)} bytes go with a frame, but there is room for {_ROOM}")
        number = int(self._heads[0]) + 1
        own_vertices, own_values, start = self._place(number)
        own_vertices[:] = vertices
        own_values[:] = values
        self._memory[start : start + 8] = len(packed).to_bytes(8, "little")
        self._memory[start + 8 : start + 8 + len(packed)] = packed
        self._heads[0] = number

    def newest(self, after: int) -> Picture | None:
        """The newest frame if its number is larger than `after`, copied."""
        while (number := int(self._heads[0])) > after:
            vertices, values, start = self._place(number)
            size = int.from_bytes(self._memory[start : start + 8], "little")
            packed = self._memory[start + 8 : start + 8 + min(size, _ROOM)]
            picture = (vertices.copy(), values.copy())
            # The place is overwritten by the frame three after it, which is begun when the one before that is pinned.
            if int(self._heads[0]) < number + _PLACES - 1:
                return Picture(number, *picture, ForkingPickler.loads(packed))
        return None

    @property
    def done(self) -> int:
        """How many orders painters have finished."""
        return int(self._heads[1])

    def count(self) -> None:
        """Note that one more order is finished."""
        self._heads[1] += 1

    def _place(self, number: int) -> tuple[Floats, Floats, int]:
        """Views of the vertices and values of a place, and where its bytes begin."""
        start, n = 64 + (number % _PLACES) * self._each, self._n
        vertices = np.frombuffer(self._memory, np.float32, 3 * n, start).reshape(n, 3)
        values = np.frombuffer(self._memory, np.float32, n, start + 12 * n)
        return vertices, values, start + 16 * n
