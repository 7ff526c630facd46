"""Compiled kernels for contact points near a collider and their derivatives, for some tens of points at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.compiled import compiled, summing

Floats = NDArray[np.floating[Any]]


# Factor for round-off of squared distances.
_ROUNDED = 1.0 + 1e-9


@compiled
def near_box(
    x: Array, rotation: Array, translation: Array, lower: Array, upper: Array, reach: Array
) -> IntArray:
    """Which of the points x (n, dim) are within reach (n,) of the box from lower to upper (dim,) of a collider at the
    pose x = R z + t."""
    n, dim = x.shape
    inside = np.empty(n, dtype=np.int64)
    count = 0
    # Most points are outside the ball about the box, too.
    radius, centre = 0.5 * np.sqrt(np.square(upper - lower).sum()), translation.copy()
    for a in range(dim):
        for b in range(dim):
            centre[a] += rotation[a, b] * 0.5 * (lower[b] + upper[b])
    for i in range(n):
        square, near = 0.0, True
        for a in range(dim):
            square += (x[i, a] - centre[a]) ** 2
        if square > _ROUNDED * (radius + reach[i] * np.sqrt(dim)) ** 2:
            continue
        for a in range(dim):
            z = 0.0
            for b in range(dim):
                z += rotation[b, a] * (x[i, b] - translation[b])
            near = near and lower[a] - reach[i] <= z <= upper[a] + reach[i]
        inside[count] = i
        count += near
    return inside[:count]


@compiled
def places(points: IntArray, among: IntArray) -> IntArray:
    """The positions of points (n,) in another list of points (m,), both ascending; -1 for points not in it."""
    found, at = np.empty(len(points), dtype=np.int64), 0
    for i in range(len(points)):
        while at < len(among) and among[at] < points[i]:
            at += 1
        found[i] = at if at < len(among) and among[at] == points[i] else -1
    return found


@compiled
def are_among(points: IntArray, others: IntArray) -> BoolArray:
    """Which of the points (n,) are among the others (m,), both ascending."""
    return places(points, others) >= 0


@compiled
def largest_norm(displacement: Array, active: IntArray) -> float:
    """max |u_j| over the active ones (k,) of the displacements (m, dim); 0 if there are none."""
    most = 0.0
    for j in active:
        square = 0.0
        for a in range(displacement.shape[1]):
            square += displacement[j, a] * displacement[j, a]
        most = max(most, square)
    return np.sqrt(most)


@compiled
def blocks_to_world(F: Array, c: Floats) -> Floats:
    """F_i c_i (k*dim, n) for c (k*dim, n)."""
    k, dim, _ = F.shape
    result = np.zeros(c.shape, c.dtype)
    for i in range(k):
        for a in range(dim):
            into = result[i * dim + a]
            for b in range(dim):
                share, row = F[i, a, b], c[i * dim + b]
                for at in range(len(into)):
                    into[at] += share * row[at]
    return result


@compiled
def projected(point: IntArray, w: Array, c: Floats) -> Floats:
    """w . c (r, n) for directions w (r, dim), each at one of the points, and c (k*dim, n)."""
    r, dim = w.shape
    result = np.zeros((r, c.shape[1]), c.dtype)
    for at in range(r):
        into = result[at]
        for b in range(dim):
            share, row = w[at, b], c[point[at] * dim + b]
            for column in range(len(into)):
                into[column] += share * row[column]
    return result


@compiled
def expanded(point: IntArray, w: Array, y: Floats, size: int) -> Floats:
    """sum w y (size, n) for y (r, n): the transpose of `projected`, size = k*dim."""
    r, dim = w.shape
    result = np.zeros((size, y.shape[1]), y.dtype)
    for at in range(r):
        for b in range(dim):
            share, into = w[at, b], result[point[at] * dim + b]
            for column in range(len(into)):
                into[column] += share * y[at, column]
    return result


@compiled
def add_basis(basis: Array, index: IntArray, moved: Array) -> None:
    """Adds U (x) I at some points (m,) to the Jacobian of the static condensation (m, dim, n_rows, dim), in place."""
    _, dim, n_rows, _ = moved.shape
    for k, i in enumerate(index):
        for a in range(dim):
            for r in range(n_rows):
                moved[k, a, r, a] += basis[i, r]


@summing
def handle_forces(basis: Array, gradients: Array, index: IntArray, force: Array, by_strain: Array) -> Array:
    """sum_j U_j (x) f_j + grad U_j S_j^T (n_rows, dim) of forces f (m, dim) on some of the points (m,), and by_strain:
    S (m, dim, dim); basis U (n, n_rows), gradients (n, dim, n_rows)."""
    n_rows, dim = basis.shape[1], force.shape[1]
    total = np.zeros((dim, n_rows))
    for j, i in enumerate(index):
        row = basis[i]
        for a in range(dim):
            into, share = total[a], force[j, a]
            for r in range(n_rows):
                into[r] += share * row[r]
            for k in range(dim):
                slope, along = gradients[i, k], by_strain[j, a, k]
                for r in range(n_rows):
                    into[r] += along * slope[r]
    return np.ascontiguousarray(total.T)
