"""Cells shared out among ranks, by recursive coordinate bisection: near cells together, as many in every part."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array, IntArray


def partition(centroids: Array, n_parts: int) -> IntArray:
    """The part (n_cells,) that each cell belongs to. centroids: (n_cells, dim).

    Cells are cut in two across their longest extent, in proportion to the number of parts that either side is to
    become, and so on with both. Numbers of cells in a part differ by a few at most.
    """
    part = np.zeros(len(centroids), dtype=np.int64)

    def cut(cells: IntArray, first: int, count: int) -> None:
        if count == 1:
            part[cells] = first
            return
        axis = int(np.argmax(np.ptp(centroids[cells], axis=0)))
        along = cells[np.argsort(centroids[cells, axis], kind="stable")]
        left = count // 2
        at = len(cells) * left // count
        cut(along[:at], first, left)
        cut(along[at:], first + left, count - left)

    cut(np.arange(len(centroids)), 0, n_parts)
    return part
