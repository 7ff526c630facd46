"""The signed distance of blunt cones and of their smooth unions, point by point. Formulas: `Cone`, `combine.py`.

A cone is given by start and axis (dim,), length, radius at the start, sin and cos; several cones by the same arrays
with a leading dimension.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled

Cones = tuple[Array, Array, Array, Array, Array, Array]


@compiled
def _value(z: Array, i: int, cones: Cones, c: int) -> float:
    """s [m] of the cone c at the point z_i: the distance to the nearest ball between the two ends."""
    start, axis, length, radius, sin, cos = cones
    y, square = 0.0, 0.0
    for a in range(z.shape[1]):
        v = z[i, a] - start[c, a]
        y += v * axis[c, a]
        square += v * v
    across = max(square - y * y, 0.0)
    centre = min(max(y - np.sqrt(across) * (sin[c] / cos[c]), 0.0), length[c])
    return float(np.sqrt(across + (y - centre) ** 2) - (radius[c] - sin[c] * centre))


@compiled
def _derivatives(z: Array, i: int, cones: Cones, c: int, gradient: Array, hessian: Array) -> float:
    """s [m] of the cone c at the point z_i; fills in its gradient (dim,) and Hessian (dim, dim). On the axis, and at
    the centre of an end's ball, where the norm is not differentiable, its derivatives are taken as zero."""
    start, axis, length, radius, sin, cos = cones
    dim = z.shape[1]
    y, across, square = 0.0, 0.0, 0.0
    for a in range(dim):
        y += (z[i, a] - start[c, a]) * axis[c, a]
    for a in range(dim):
        across += (z[i, a] - start[c, a] - y * axis[c, a]) ** 2
    foot = y - np.sqrt(across) * (sin[c] / cos[c])
    centre = min(max(foot, 0.0), length[c])
    for a in range(dim):
        square += (z[i, a] - start[c, a] - centre * axis[c, a]) ** 2
    r = np.sqrt(square)
    inverse = 1.0 / r if r > 0.0 else 0.0
    for a in range(dim):
        gradient[a] = (z[i, a] - start[c, a] - centre * axis[c, a]) * inverse
    # The curvature vanishes on the side along the line to the axis, on an end's ball along the normal.
    on_side = foot == centre and across > 0.0
    for a in range(dim):
        for b in range(a + 1):
            if on_side:
                v = z[i, a] - start[c, a] - y * axis[c, a]
                w = z[i, b] - start[c, b] - y * axis[c, b]
                bent = v * w / across + axis[c, a] * axis[c, b]
            else:
                bent = gradient[a] * gradient[b]
            hessian[a, b] = hessian[b, a] = ((1.0 if a == b else 0.0) - bent) * inverse
    return float(r - (radius[c] - sin[c] * centre))


def _union(z: Array, cones: Cones, blend: float) -> Array:
    """The smooth minimum of the distances of one cone after the other."""
    union = np.full(len(z), np.inf)
    for start, axis, length, radius, sin, cos in zip(*cones):
        y = (z - start) @ axis
        across = np.linalg.norm(z - start - y[:, None] * axis, axis=1)
        centre = np.clip(y - across * sin / cos, 0.0, length)
        part = np.hypot(across, y - centre) - (radius - sin * centre)
        union = np.minimum(union, part) - blend / 6 * np.maximum(0.0, 1.0 - np.abs(union - part) / blend) ** 3
    return union


@compiled(reference=_union)
def values(z: Array, cones: Cones, blend: float) -> Array:
    """s (n,) [m] at points z (n, dim) of the smooth union of p cones."""
    n, p = len(z), len(cones[0])
    value = np.empty(n)
    for i in range(n):
        total = _value(z, i, cones, 0)
        for c in range(1, p):
            part = _value(z, i, cones, c)
            t = min(abs(total - part) / blend, 1.0)
            total = min(total, part) - blend / 6.0 * (1.0 - t) ** 3
        value[i] = total
    return value


@compiled
def derivatives(z: Array, cones: Cones, blend: float) -> tuple[Array, Array, Array]:
    """The same with gradient (n, dim) and Hessian (n, dim, dim). Of cones that do not affect the union at a point, only
    the value is evaluated there."""
    (n, dim), p = z.shape, len(cones[0])
    value, gradient, hessian = np.empty(n), np.empty((n, dim)), np.empty((n, dim, dim))
    slope, curvature = np.empty(dim), np.empty((dim, dim))
    for i in range(n):
        g, H = gradient[i], hessian[i]
        total = _derivatives(z, i, cones, 0, g, H)
        for c in range(1, p):
            part = _value(z, i, cones, c)
            if part >= total + blend:
                continue
            _derivatives(z, i, cones, c, slope, curvature)
            difference = total - part
            t = min(abs(difference) / blend, 1.0)
            first = 0.5 * np.sign(difference) * ((1.0 - t) ** 2 - 1.0)
            second, of_total, of_part = -(1.0 - t) / blend, 0.5 + first, 0.5 - first
            for a in range(dim):
                for b in range(dim):
                    apart = (g[a] - slope[a]) * (g[b] - slope[b])
                    H[a, b] = of_total * H[a, b] + of_part * curvature[a, b] + second * apart
            for a in range(dim):
                g[a] = of_total * g[a] + of_part * slope[a]
            total = min(total, part) - blend / 6.0 * (1.0 - t) ** 3
        value[i] = total
    return value, gradient, hessian
