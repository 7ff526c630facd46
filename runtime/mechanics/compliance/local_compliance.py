"""A cache of the compliance among the contact nodes of one contact, contiguous in memory.

The compliance among all contact nodes of a body is hundreds of megabytes. A contact needs some tens of thousands of
scattered entries, and the next state nearly the same ones. The cache affects the cost and never the result: an instance
may be shared by states, simulators and threads.
"""

from __future__ import annotations

from functools import partial
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray, same
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import (
    copy_pairs,
    displacement,
    displacement_of_many,
    gathered,
)

# Nodes whose rows and columns are cached. The cache grows where a single request needs more.
_ROOM = 768
# The displacement of so many times as many nodes as there are with forces is read from the rows of these, in the order
# of memory: less work than to copy all of it into the cache.
_MANY = 4
# The nodes whose displacement tells of that of all others, and the most by which another goes farther than these and
# those that bear forces. With 3,000 loads on up to 29 neighbouring nodes of beams with one frame and 0, 2 or 8 points
# it is 1.15; with the nodes that bear forces alone up to 7.6, where the load is near the frame and moves the far end.
_TELLING, _FARTHER = 32, 1.25


class LocalCompliance:
    """all_pairs: (n_nodes, n_nodes, dim, dim) [m/N], from `SurfaceCompliance.among_nodes`: symmetric. The rows and
    columns of recently used nodes are cached as copies."""

    def __init__(self, all_pairs: NDArray[np.float32]) -> None:
        self._all_pairs = all_pairs
        self._reset()

    def __getstate__(self) -> dict[str, Any]:
        """Without the cache."""
        return {"_all_pairs": self._all_pairs}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._all_pairs = state["_all_pairs"]
        self._reset()

    def __len__(self) -> int:
        """The number of contact nodes."""
        return len(self._all_pairs)

    def _reset(self) -> None:
        self._lock = Lock()
        self._slot: IntArray = np.empty(len(self._all_pairs), dtype=np.int64)
        self._count = 0
        self._forget(_ROOM)
        nothing = np.empty((0, 0), dtype=np.float32)
        self._last: tuple[IntArray, NDArray[np.float32]] = np.empty(0, dtype=np.int64), nothing

    def among(self, nodes: IntArray) -> NDArray[np.float32]:
        """G (m*dim, m*dim) [m/N] among the nodes (m,)."""
        last = self._last  # read once, as another thread may replace it
        if not same(nodes, last[0]):
            slots, pairs = self._slots(nodes)
            self._last = last = nodes.copy(), gathered(pairs, slots)
        return last[1]

    def displacement(self, at: IntArray, nodes: IntArray, forces: Array) -> Array:
        """sum_j G_ij phi_j (n, dim) [m] at nodes `at` (n,) by forces phi (m, dim) [N] on nodes (m,), both in rest
        coordinates. That of many nodes is read from all pairs: what is cached is for the nodes of a contact."""
        if len(at) > _MANY * len(nodes):
            return displacement_of_many(self._all_pairs, at, nodes, forces)
        slots, pairs = self._slots(np.concatenate([at, nodes]))
        return displacement(pairs, slots[: len(at)], slots[len(at) :], forces)

    def farthest(self, nodes: IntArray, forces: Array) -> float:
        """How far [m] no node is displaced by forces phi (m, dim) [N] on nodes (m,), at least one: those that bear the
        forces need not go farthest, as the free end of a limb does that is pressed near its frame."""
        moved = self.displacement(np.concatenate([nodes, self._telling]), nodes, forces)
        return _FARTHER * float(np.sqrt(np.einsum("ia,ia->i", moved, moved).max()))

    @lazy
    def _telling(self) -> IntArray:
        """Nodes by whose displacement that of the others is known best: the pivots of a Cholesky factorisation of the
        traces of G. Forces phi do not displace a node farther than sqrt(G_jj . phi G phi), with what is left of G_jj
        where these nodes are held."""
        traces = partial(np.einsum, "jaa->j", dtype=np.float64)
        every = np.arange(len(self))
        left, columns, chosen = traces(self._all_pairs[every, every]), np.zeros((len(self), _TELLING)), []
        for k in range(min(_TELLING, len(self))):
            pivot = int(np.argmax(left))
            if left[pivot] <= 0.0:
                break
            column = traces(self._all_pairs[pivot]) - columns[:, :k] @ columns[pivot, :k]
            columns[:, k] = column / np.sqrt(left[pivot])
            left -= np.square(columns[:, k])
            left[pivot] = 0.0
            chosen.append(pivot)
        return np.array(chosen, dtype=np.int64)

    def _slots(self, nodes: IntArray) -> tuple[IntArray, NDArray[np.float32]]:
        """The slots of the nodes (m,) in the cache, and the cache. Only one thread at a time changes the slots; the
        cached entries of a returned slot do not change."""
        with self._lock:
            missing = self._slot[nodes] < 0
            if missing.any():
                new = np.unique(nodes[missing])
                if self._count + len(new) > len(self._known):
                    new = np.unique(nodes)
                    self._forget(max(len(self._known), min(2 * len(new), len(self._slot))))
                self._take(new)
            return np.asarray(self._slot[nodes]), self._pairs

    def _take(self, new: IntArray) -> None:
        before, after = self._count, self._count + len(new)
        self._known[before:after] = new
        self._slot[new] = np.arange(before, after)
        copy_pairs(self._all_pairs, self._known[:after], before, self._pairs)
        self._count = after

    def _forget(self, room: int) -> None:
        self._slot[:] = -1
        self._count = 0
        self._known: IntArray = np.empty(room, dtype=np.int64)
        self._pairs: NDArray[np.float32] = np.empty(
            (room, room, *self._all_pairs.shape[2:]), dtype=np.float32
        )
