"""Bounds of deformed cells and facets."""

from __future__ import annotations

import math

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled


def _balls(x: Array, simplices: IntArray) -> tuple[Array, Array]:
    centre = x[simplices].mean(axis=1)
    return centre, np.linalg.norm(x[simplices] - centre[:, None], axis=2).max(axis=1, initial=0.0)


@compiled(reference=_balls)
def bounding_balls(x: Array, simplices: IntArray) -> tuple[Array, Array]:
    """Balls that contain simplices (n, c) with their nodes at x (n_nodes, dim): the mean of the corners (n, dim), and
    the distance of the farthest corner from it (n,)."""
    n, c = simplices.shape
    dim = x.shape[1]
    centre, radius = np.zeros((n, dim)), np.zeros(n)
    for i in range(n):
        for a in range(c):
            for axis in range(dim):
                centre[i, axis] += x[simplices[i, a], axis] / c
        for a in range(c):
            square = 0.0
            for axis in range(dim):
                square += (x[simplices[i, a], axis] - centre[i, axis]) ** 2
            radius[i] = max(radius[i], math.sqrt(square))
    return centre, radius
