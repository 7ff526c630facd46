"""Greedy farthest-point selection with any distance: each choice is the farthest from all chosen before
(thesis 5.3.2).

Every prefix of the result is the greedy choice of that length, so that a part of the plan is useful.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softprint.runtime.arrays import Array, IntArray


def farthest_selection(distance_from: Callable[[int], Array], first: int, count: int) -> IntArray:
    """``count`` candidates in order of choice, beginning with ``first``.

    distance_from(k): (n,) distances of all candidates from candidate k. Ties go to the lowest index. The
    result is shorter than ``count`` if every further candidate coincides with a chosen one.
    """
    chosen = [first]
    nearest = np.array(distance_from(first), dtype=float)
    nearest[first] = 0.0
    while len(chosen) < count:
        candidate = int(np.argmax(nearest))
        if nearest[candidate] <= 0.0:
            break
        chosen.append(candidate)
        np.minimum(nearest, distance_from(candidate), out=nearest)
        nearest[candidate] = 0.0
    return np.array(chosen, dtype=np.int64)
