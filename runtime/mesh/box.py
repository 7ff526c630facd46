"""A structured box of triangles or tetrahedra: the body of examples, tests and benchmarks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from softprint.runtime.mesh.check import oriented_mesh
from softprint.runtime.mesh.mesh import Mesh


def box_mesh(lower: Sequence[float], upper: Sequence[float], divisions: Sequence[int]) -> Mesh:
    """The axis-aligned box from ``lower`` to ``upper`` [m] with ``divisions`` cubes along each axis.

    Each square is cut into 2 triangles, each cube into 6 tetrahedra (Kuhn's subdivision: one simplex for each order of
    the axes on a path from the low corner to the high one).
    """
    dim = len(divisions)
    axes = [np.linspace(a, b, n + 1) for a, b, n in zip(lower, upper, divisions, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    counts = np.asarray(divisions) + 1
    strides = np.array([int(np.prod(counts[axis + 1 :])) for axis in range(dim)])
    low = (
        np.stack(np.meshgrid(*[np.arange(n) for n in divisions], indexing="ij"), axis=-1).reshape(-1, dim)
        @ strides
    )
    walks = [np.concatenate([[0], np.cumsum(strides[list(order)])]) for order in permutations(range(dim))]
    cells = (low[:, None, None] + np.array(walks)).reshape(-1, dim + 1)
    return oriented_mesh(points, cells)
