"""The signed distance of a blunt cone, point by point; formulas: `Cone`."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.compiled import compiled


@compiled
def values(
    z: Array, start: Array, axis: Array, length: float, radii: tuple[float, float], sin: float, cos: float
) -> Array:
    """s (n,) [m] at points z (n, dim); radii: at the start and at the end."""
    n, dim = z.shape
    value = np.empty(n)
    for i in range(n):
        y, square = 0.0, 0.0
        for a in range(dim):
            v = z[i, a] - start[a]
            y += v * axis[a]
            square += v * v
        across = 0.0
        for a in range(dim):
            across += (z[i, a] - start[a] - y * axis[a]) ** 2
        x = np.sqrt(across)
        foot = y - x * sin / cos
        if foot < 0.0:
            value[i] = np.sqrt(square) - radii[0]
        elif foot > length:
            value[i] = np.sqrt(across + (y - length) ** 2) - radii[1]
        else:
            value[i] = cos * x + sin * y - radii[0]
    return value


@compiled
def derivatives(
    z: Array, start: Array, axis: Array, length: float, radii: tuple[float, float], sin: float, cos: float
) -> tuple[Array, Array, Array]:
    """s (n,), its gradient (n, dim) and Hessian (n, dim, dim). On the axis, and in the middle of an end's ball, the
    norm has no derivatives: there they are those of zero."""
    n, dim = z.shape
    value, gradient, hessian = np.empty(n), np.zeros((n, dim)), np.zeros((n, dim, dim))
    v = np.empty(dim)
    for i in range(n):
        y, across = 0.0, 0.0
        for a in range(dim):
            y += (z[i, a] - start[a]) * axis[a]
        for a in range(dim):
            v[a] = z[i, a] - start[a] - y * axis[a]
            across += v[a] * v[a]
        x = np.sqrt(across)
        foot = y - x * sin / cos
        at_start, at_end = foot < 0.0, foot > length
        if at_start or at_end:
            along = y if at_start else y - length
            square = 0.0
            for a in range(dim):
                v[a] += along * axis[a]
                square += v[a] * v[a]
            r = np.sqrt(square)
            value[i] = r - (radii[0] if at_start else radii[1])
            for a in range(dim):
                if r > 0.0:
                    gradient[i, a] = v[a] / r
                    for b in range(dim):
                        hessian[i, a, b] = ((1.0 if a == b else 0.0) - v[a] * v[b] / square) / r
        else:
            value[i] = cos * x + sin * y - radii[0]
            for a in range(dim):
                gradient[i, a] = sin * axis[a]
                if x > 0.0:
                    gradient[i, a] += cos * v[a] / x
                    for b in range(dim):
                        flat = (1.0 if a == b else 0.0) - v[a] * v[b] / across - axis[a] * axis[b]
                        hessian[i, a, b] = cos * flat / x
    return value, gradient, hessian
