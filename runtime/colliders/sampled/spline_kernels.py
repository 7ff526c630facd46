"""The sums of `spline.py`, point by point: 64 coefficients in 3D, 16 in 2D, axis by axis from the last.

Common arguments: z (n, dim) [m]; the grid's origin (dim,), spacing, last cell (dim,) and strides (dim,), the last of
which is 1; and the coefficients, flat. A point outside the grid is extrapolated from the nearest cell; a nan point
gives nan.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled

# The uniform cubic B-spline: polynomial by power of the fraction f, times 6.
_CUBIC = np.array(
    [[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]
)


def _sums(
    z: Array, origin: Array, spacing: float, last: Array, strides: IntArray, c: Array
) -> tuple[Array, Array, Array]:
    """Value (n,), gradient (n, dim) and Hessian (n, dim, dim): the coefficients of the cell times the polynomials, or
    their derivatives, along every axis."""
    n, dim = z.shape
    t = (z - origin) / spacing
    cell = np.clip(np.floor(t), 0.0, last).astype(int)
    f = t - cell
    powers = np.stack([np.ones_like(f), f, f**2, f**3], axis=-1)
    slopes = np.stack([np.zeros_like(f), np.ones_like(f), 2 * f, 3 * f**2], axis=-1) / spacing
    bends = np.stack([np.zeros_like(f), np.zeros_like(f), 2 + 0 * f, 6 * f], axis=-1) / spacing**2
    b = np.array([powers, slopes, bends]) @ _CUBIC.T / 6  # (order, n, dim, 4)
    offsets = np.add.outer(np.arange(4) * strides[0], np.arange(4) * strides[1])
    if dim == 3:
        offsets = np.add.outer(offsets, np.arange(4) * strides[2])
    block = c[(cell @ strides).reshape(-1, *[1] * dim) + offsets]

    def total(orders: IntArray) -> Array:
        along = [b[order, :, axis] for axis, order in enumerate(orders)]
        return np.einsum("nij,ni,nj->n" if dim == 2 else "nijk,ni,nj,nk->n", block, *along)

    unit = np.eye(dim, dtype=int)
    gradient = np.stack([total(unit[a]) for a in range(dim)], axis=-1)
    hessian = np.stack([total(unit[a] + unit[b]) for a in range(dim) for b in range(dim)], axis=-1)
    return total(0 * unit[0]), gradient, hessian.reshape(n, dim, dim)


@compiled
def _polynomials(f: float, b: Array) -> None:
    """b (3, 4): the four polynomials at the fraction f, their first and their second derivatives."""
    g = 1.0 - f
    b[0, 0], b[0, 1] = g * g * g / 6.0, (3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0
    b[0, 3], b[0, 2] = f * f * f / 6.0, (3.0 * g * g * g - 6.0 * g * g + 4.0) / 6.0
    b[1, 0], b[1, 1] = -g * g / 2.0, (3.0 * f * f - 4.0 * f) / 2.0
    b[1, 3], b[1, 2] = f * f / 2.0, -(3.0 * g * g - 4.0 * g) / 2.0
    b[2, 0], b[2, 1], b[2, 2], b[2, 3] = g, 3.0 * f - 2.0, 3.0 * g - 2.0, f


@compiled
def _locate(point: Array, origin: Array, spacing: float, last: Array, strides: IntArray, b: Array) -> int:
    """Index of the first coefficient of a point's cell; fills in b (dim, 3, 4), its polynomials along each axis."""
    first = 0
    for axis in range(len(point)):
        t = (point[axis] - origin[axis]) / spacing
        cell = (
            min(np.floor(t), last[axis]) if t > 0.0 else 0.0
        )  # also for nan, which must not become an index
        first += int(cell) * strides[axis]
        _polynomials(t - cell, b[axis])
    return first


@compiled
def _line(c: Array, at: int, b: Array) -> float:
    return c[at] * b[0] + c[at + 1] * b[1] + c[at + 2] * b[2] + c[at + 3] * b[3]


@compiled
def _plane(c: Array, at: int, stride: int, b: Array) -> tuple[float, float, float, float, float, float]:
    """s, s_x, s_y, s_xx, s_xy, s_yy of the 4 x 4 coefficients from `at`; b (2, 3, 4): of the axes x and y."""
    s = s_x = s_y = s_xx = s_xy = s_yy = 0.0
    for i in range(4):
        along = at + i * stride
        s_0, s_1, s_2 = _line(c, along, b[1, 0]), _line(c, along, b[1, 1]), _line(c, along, b[1, 2])
        s, s_x, s_xx = s + b[0, 0, i] * s_0, s_x + b[0, 1, i] * s_0, s_xx + b[0, 2, i] * s_0
        s_y, s_xy, s_yy = s_y + b[0, 0, i] * s_1, s_xy + b[0, 1, i] * s_1, s_yy + b[0, 0, i] * s_2
    return s, s_x, s_y, s_xx, s_xy, s_yy


@compiled
def _flat(c: Array, at: int, stride: int, b: Array) -> tuple[float, float, float]:
    """s, s_x, s_y of the 4 x 4 coefficients from `at`; b (2, 3, 4): of the axes x and y."""
    s = s_x = s_y = 0.0
    for i in range(4):
        along = at + i * stride
        t = _line(c, along, b[1, 0])
        s, s_x, s_y = s + b[0, 0, i] * t, s_x + b[0, 1, i] * t, s_y + b[0, 0, i] * _line(c, along, b[1, 1])
    return s, s_x, s_y


@compiled
def _value(first: int, strides: IntArray, b: Array, c: Array) -> float:
    """The sum over the coefficients of a cell from `first`."""
    total = 0.0
    for i in range(4):
        along = first + i * strides[0]
        if len(b) == 2:
            total += b[0, 0, i] * _line(c, along, b[1, 0])
        else:
            for j in range(4):
                total += b[0, 0, i] * b[1, 0, j] * _line(c, along + j * strides[1], b[2, 0])
    return total


@compiled(reference=lambda *arguments: _sums(*arguments[:6])[0])
def values(
    z: Array, origin: Array, spacing: float, last: Array, strides: IntArray, c: Array, value: Array
) -> None:
    """Fills in value (n,)."""
    n, dim = z.shape
    b = np.empty((dim, 3, 4))
    for point in range(n):
        value[point] = _value(_locate(z[point], origin, spacing, last, strides, b), strides, b, c)


@compiled(reference=lambda *arguments: _sums(*arguments[:6])[:2])
def gradients(
    z: Array,
    origin: Array,
    spacing: float,
    last: Array,
    strides: IntArray,
    c: Array,
    value: Array,
    gradient: Array,
) -> None:
    """Fills in value (n,) and gradient (n, dim)."""
    n, dim = z.shape
    b = np.empty((dim, 3, 4))
    for point in range(n):
        first = _locate(z[point], origin, spacing, last, strides, b)
        s = s_x = s_y = s_z = 0.0
        if dim == 2:
            s, s_x, s_y = _flat(c, first, strides[0], b)
        else:
            for i in range(4):
                t, t_y, t_z = _flat(c, first + i * strides[0], strides[1], b[1:])
                s, s_x = s + b[0, 0, i] * t, s_x + b[0, 1, i] * t
                s_y, s_z = s_y + b[0, 0, i] * t_y, s_z + b[0, 0, i] * t_z
        value[point] = s
        gradient[point, 0], gradient[point, 1] = s_x / spacing, s_y / spacing
        if dim == 3:
            gradient[point, 2] = s_z / spacing


@compiled
def _derivatives(
    first: int, spacing: float, strides: IntArray, b: Array, c: Array, g: Array, h: Array
) -> float:
    """The value of a cell's sum from `first`; fills in its gradient g (dim,) and Hessian h (dim, dim)."""
    dim, value = len(b), 0.0
    if dim == 2:
        value, g[0], g[1], h[0, 0], h[0, 1], h[1, 1] = _plane(c, first, strides[0], b)
    else:
        g[:], h[:] = 0.0, 0.0
        for i in range(4):
            plane = _plane(c, first + i * strides[0], strides[1], b[1:])
            x, x_1, x_2 = b[0, 0, i], b[0, 1, i], b[0, 2, i]
            value += x * plane[0]
            g[0] += x_1 * plane[0]
            g[1] += x * plane[1]
            g[2] += x * plane[2]
            h[0, 0] += x_2 * plane[0]
            h[0, 1] += x_1 * plane[1]
            h[0, 2] += x_1 * plane[2]
            h[1, 1] += x * plane[3]
            h[1, 2] += x * plane[4]
            h[2, 2] += x * plane[5]
    for i in range(dim):
        g[i] /= spacing
        for j in range(i, dim):
            h[i, j] /= spacing * spacing
            h[j, i] = h[i, j]
    return value


@compiled(reference=lambda *arguments: _sums(*arguments[:6]))
def derivatives(
    z: Array,
    origin: Array,
    spacing: float,
    last: Array,
    strides: IntArray,
    c: Array,
    value: Array,
    gradient: Array,
    hessian: Array,
) -> None:
    """Fills in value (n,), gradient (n, dim) and hessian (n, dim, dim)."""
    n, dim = z.shape
    b = np.empty((dim, 3, 4))
    for point in range(n):
        first = _locate(z[point], origin, spacing, last, strides, b)
        value[point] = _derivatives(first, spacing, strides, b, c, gradient[point], hessian[point])


@compiled
def _to_local(x: Array, rotation: Array, translation: Array, z: Array) -> None:
    """z = R^T (x - t) of one point."""
    dim = len(x)
    for a in range(dim):
        z[a] = 0.0
        for i in range(dim):
            z[a] += rotation[i, a] * (x[i] - translation[i])


def _sums_within(
    rotation: Array, translation: Array, lower: Array, upper: Array, x: Array, *grid: Any
) -> tuple[bool, Array, Array, Array]:
    z = (x - translation) @ rotation
    return bool(((lower <= z) & (z <= upper)).all()), *_sums(z, *grid)


@compiled(reference=_sums_within)
def derivatives_within(
    rotation: Array,
    translation: Array,
    lower: Array,
    upper: Array,
    x: Array,
    origin: Array,
    spacing: float,
    last: Array,
    strides: IntArray,
    c: Array,
) -> tuple[bool, Array, Array, Array]:
    """Whether all points x = R z + t (n, dim) lie in the box from lower to upper (dim,), and if so the values (n,),
    gradients (n, dim) and Hessians (n, dim, dim) with respect to z."""
    n, dim = x.shape
    value, gradient, hessian = np.empty(n), np.empty((n, dim)), np.empty((n, dim, dim))
    b, z = np.empty((dim, 3, 4)), np.empty(dim)
    for point in range(n):
        _to_local(x[point], rotation, translation, z)
        for a in range(dim):
            if not lower[a] <= z[a] <= upper[a]:
                return False, value, gradient, hessian
        first = _locate(z, origin, spacing, last, strides, b)
        value[point] = _derivatives(first, spacing, strides, b, c, gradient[point], hessian[point])
    return True, value, gradient, hessian


def _sums_below(
    x: Array, rotation: Array, translation: Array, lower: Array, upper: Array, distance: float, *grid: Any
) -> tuple[IntArray, Array, Array]:
    origin, spacing, last, strides, _, c = grid
    z = (x - translation) @ rotation
    value = _sums(z, origin, spacing, last, strides, c)[0]
    index = np.flatnonzero(((lower < z) & (z < upper)).all(axis=1) & (value < distance))
    return index, z[index], value[index]


@compiled(reference=_sums_below)
def closer(
    x: Array,
    rotation: Array,
    translation: Array,
    lower: Array,
    upper: Array,
    distance: float,
    origin: Array,
    spacing: float,
    last: Array,
    strides: IntArray,
    least: Array,
    c: Array,
) -> tuple[IntArray, Array, Array]:
    """Indices (m,) of the points x = R z + t (n, dim) that lie in the box from lower to upper (dim,) and have values
    below `distance`, with their z (m, dim) and values (m,). least: a lower bound of the value in each cell."""
    n, dim = x.shape
    index, near, value = np.empty(n, dtype=np.int64), np.empty((n, dim)), np.empty(n)
    b, z = np.empty((dim, 3, 4)), np.empty(dim)
    count = 0
    for point in range(n):
        inside = True
        _to_local(x[point], rotation, translation, z)
        for a in range(dim):
            inside = inside and lower[a] < z[a] < upper[a]
        if not inside:
            continue
        first = 0
        for a in range(dim):
            cell = min(max(np.floor((z[a] - origin[a]) / spacing), 0.0), last[a])
            first += int(cell) * strides[a]
        if least[first] >= distance:
            continue
        found = _value(_locate(z, origin, spacing, last, strides, b), strides, b, c)
        if found < distance:
            index[count], near[count], value[count] = point, z, found
            count += 1
    return index[:count], near[:count], value[:count]
