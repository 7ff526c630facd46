"""Partition of cells by recursive coordinate bisection: compact parts of equal size."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, IntArray


def partition(centroids: Array, n_parts: int) -> IntArray:
    """The part (n_cells,) that each cell belongs to. centroids: (n_cells, dim).

    Cells are cut in two across their longest extent, in proportion to the number of parts on either side, recursively.
    Sizes of the parts differ by a few cells at most.
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
