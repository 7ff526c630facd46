"""What loads near each other do to each other, kept close together in memory.

The compliance among all loads of a body is hundreds of megabytes, of which a contact needs some tens of thousands of
entries, scattered. The next state needs nearly the same ones.
"""

from __future__ import annotations

from threading import Lock

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray, same
from runtime.mechanics.surface_compliance_kernels import displacement, gathered

# Loads that are kept; more are made room for when they are asked for at once.
_ROOM = 384


class LocalCompliance:
    """among: (n_loads, n_loads, dim, dim) [m/N], of `SurfaceCompliance.among_loads`; the rows and columns of loads
    that were lately asked for are copied."""

    def __init__(self, among: NDArray[np.float32]) -> None:
        self._among = among
        self._slot: IntArray = np.empty(len(among), dtype=np.int64)
        self._count = 0
        self._lock = Lock()
        self._forget(_ROOM)
        self._gathered_for: IntArray = np.empty(0, dtype=np.int64)
        self._gathered: NDArray[np.float32] = np.empty((0, 0), dtype=np.float32)

    def compliance(self, loads: IntArray) -> NDArray[np.float32]:
        """G (m*dim, m*dim) [m/N] among the loads (m,). The last one is kept: from one state to the next the loads are
        often the same. For one thread."""
        if not same(loads, self._gathered_for):
            slots, pairs = self._slots(loads)
            self._gathered_for, self._gathered = loads.copy(), gathered(pairs, slots)
        return self._gathered

    def displacement(self, at: IntArray, loads: IntArray, forces: Array) -> Array:
        """sum_j G_ij phi_j (n, dim) [m] at some loads (n,) by forces phi (m, dim) [N] on others (m,), at rest."""
        slots, pairs = self._slots(np.concatenate([at, loads]))
        return displacement(pairs, slots[: len(at)], slots[len(at) :], forces)

    def _slots(self, loads: IntArray) -> tuple[IntArray, NDArray[np.float32]]:
        """Which rows and columns are those of the loads, of what is kept. One thread at a time finds and makes room;
        what it was given stays as it is, whoever asks next."""
        with self._lock:
            missing = self._slot[loads] < 0
            if missing.any():
                new = np.unique(loads[missing])
                if self._count + len(new) > len(self._known):
                    new = np.unique(loads)
                    self._forget(max(len(self._known), min(2 * len(new), len(self._slot))))
                self._take(new)
            return np.asarray(self._slot[loads]), self._pairs

    def _take(self, new: IntArray) -> None:
        before, after = self._count, self._count + len(new)
        self._known[before:after] = new
        self._slot[new] = np.arange(before, after)
        everyone = self._known[:after]
        self._pairs[before:after, :after] = self._among[new[:, None], everyone]
        self._pairs[:before, before:after] = self._among[everyone[:before, None], new]
        self._count = after

    def _forget(self, room: int) -> None:
        self._slot[:] = -1
        self._count = 0
        self._known: IntArray = np.empty(room, dtype=np.int64)
        self._pairs: NDArray[np.float32] = np.empty((room, room, *self._among.shape[2:]), dtype=np.float32)
