"""Farthest-point sampling: spread a few samples evenly over many candidates."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, IntArray


def farthest_points(
    points: Array, count: int, *, first: int | None = None, distance: Array | None = None
) -> IntArray:
    """Indices of ``count`` of the points (n, dim), each the farthest from all chosen before it.

    Start from ``first``, or from given distances (n,) to what is already chosen, or (neither given) with
    the point farthest from the centroid. Deterministic: ties go to the lowest index. Returns (min(count,
    n),) in order of choice.
    """
    count = min(count, len(points))
    chosen = np.empty(count, dtype=np.int64)
    if count == 0:
        return chosen
    nearest = np.full(len(points), np.inf) if distance is None else np.square(distance)
    if first is not None:
        chosen[0] = first
    elif distance is not None:
        chosen[0] = np.argmax(nearest)
    else:
        chosen[0] = np.argmax(np.square(points - points.mean(axis=0)).sum(axis=1))
    for k in range(count):
        if k:
            chosen[k] = np.argmax(nearest)
        offset = points - points[chosen[k]]
        np.minimum(nearest, np.einsum("nd,nd->n", offset, offset), out=nearest)
        nearest[chosen[k]] = -1.0  # never chosen twice, even among coincident points
    return chosen
