"""Compiled kernels of `piercing.py`."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.compiled import compiled


@compiled(reference=lambda x: (x.min(axis=0), x.max(axis=0)))
def bounds(x: Array) -> tuple[Array, Array]:
    """The corners (dim,) of the box about points x (n, dim), of which there is at least one."""
    lower, upper = x[0].copy(), x[0].copy()
    for i in range(1, len(x)):
        for a in range(x.shape[1]):
            lower[a], upper[a] = min(lower[a], x[i, a]), max(upper[a], x[i, a])
    return lower, upper


@compiled(reference=lambda x, lower, upper: np.flatnonzero(((x >= lower) & (x <= upper)).all(axis=1)))
def in_box(x: Array, lower: Array, upper: Array) -> IntArray:
    """Which of the points x (n, dim) are in the box from lower to upper (dim,)."""
    inside, count = np.empty(len(x), dtype=np.int64), 0
    for i in range(len(x)):
        within = True
        for a in range(x.shape[1]):
            within = within and lower[a] <= x[i, a] <= upper[a]
        inside[count] = i
        count += within
    return inside[:count]


def _farther_from_all(z: Array, y: Array, limit: float) -> BoolArray:
    apart = np.sqrt(((z[:, None] - y[None]) ** 2).sum(axis=2))
    return np.asarray(apart.min(axis=1, initial=np.inf) > limit)


@compiled(reference=_farther_from_all)
def farther_from_all(z: Array, y: Array, limit: float) -> BoolArray:
    """Whether points z (m, dim) are farther than the limit from every other y (n, dim). Of these only some are looked
    at: sorted along the first axis, those within the limit along it."""
    m, dim = z.shape
    far = np.ones(m, dtype=np.bool_)
    order = np.argsort(y[:, 0])
    along = y[order, 0]
    first, last = np.searchsorted(along, z[:, 0] - limit), np.searchsorted(along, z[:, 0] + limit, side="right")
    for i in range(m):
        for j in order[first[i] : last[i]]:
            square = 0.0
            for a in range(dim):
                square += (z[i, a] - y[j, a]) ** 2
            if square <= limit**2:
                far[i] = False
                break
    return far


def _nearest_points(z: Array, y: Array, order: IntArray, axis: int) -> tuple[IntArray, Array]:
    apart = np.sqrt(((z[:, None] - y[None]) ** 2).sum(axis=2))
    return apart.argmin(axis=1), apart.min(axis=1)


@compiled(reference=_nearest_points)
def nearest_points(z: Array, y: Array, order: IntArray, axis: int) -> tuple[IntArray, Array]:
    """Which of the points y (n, dim) is nearest to each of z (m, dim), (m,), and how far it is (m,). order: (n,) sorts
    y along the axis: both ways from z, until one is farther along it than the nearest so far."""
    (m, dim), n = z.shape, len(y)
    along = y[order, axis]
    nearest, distance = np.zeros(m, dtype=np.int64), np.empty(m)
    begin = np.searchsorted(along, z[:, axis])
    for i in range(m):
        least, up, down = np.inf, begin[i], begin[i] - 1
        while up < n or down >= 0:
            for j in (up, down):
                if j < 0 or j >= n:
                    continue
                square = 0.0
                for a in range(dim):
                    square += (z[i, a] - y[order[j], a]) ** 2
                if square < least:
                    least, nearest[i] = square, order[j]
            up = up + 1 if up < n and (along[up] - z[i, axis]) ** 2 < least else n
            down = down - 1 if down >= 0 and (along[down] - z[i, axis]) ** 2 < least else -1
        distance[i] = np.sqrt(least)
    return nearest, distance
