"""Quadrature on triangles and tetrahedra by Gauss-Jacobi rules in collapsed coordinates (Stroud 1971)."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.special import roots_jacobi

from softprint.runtime.arrays import Array


def simplex_rule(dim: int, count: int) -> tuple[Array, Array]:
    """Barycentric points (n, dim+1) and weights (n,) that sum to one; exact for degree 2 count - 1, n = count^dim.

    On axis k the weight function is (1 - t)^(dim-1-k), the Jacobian of collapsing a cube to a simplex.
    """
    rules = [roots_jacobi(count, dim - 1 - axis, 0) for axis in range(dim)]
    points, weights = [], []
    for chosen in product(range(count), repeat=dim):
        left, weight, barycentric = 1.0, 1.0, []
        for axis, index in enumerate(chosen):
            share = 0.5 * (1.0 + rules[axis][0][index])
            barycentric.append(left * share)
            left *= 1.0 - share
            weight *= rules[axis][1][index]
        points.append([left, *barycentric])
        weights.append(weight)
    return np.array(points), np.array(weights) / np.sum(weights)
