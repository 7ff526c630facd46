"""How loads lie about a collider, and how they move with the body, compiled: arrays are of some tens of loads."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, BoolArray, IntArray
from runtime.compiled import compiled, summing

Floats = NDArray[np.floating[Any]]


@compiled
def within(
    x: Array, rotation: Array, translation: Array, lower: Array, upper: Array, reach: Array
) -> IntArray:
    """Which of the points x (n, dim) are within reach (n,) of the box from lower to upper (dim,) of a collider at the
    pose x = R z + t."""
    n, dim = x.shape
    inside = np.empty(n, dtype=np.int64)
    count = 0
    for i in range(n):
        near = True
        for a in range(dim):
            z = 0.0
            for b in range(dim):
                z += rotation[b, a] * (x[i, b] - translation[b])
            near = near and lower[a] - reach[i] <= z <= upper[a] + reach[i]
        inside[count] = i
        count += near
    return inside[:count]


@compiled
def places(loads: IntArray, among: IntArray) -> IntArray:
    """Where the loads (n,) are among others (m,), both ascending; -1 for those that are not."""
    found, at = np.empty(len(loads), dtype=np.int64), 0
    for i in range(len(loads)):
        while at < len(among) and among[at] < loads[i]:
            at += 1
        found[i] = at if at < len(among) and among[at] == loads[i] else -1
    return found


@compiled
def are_among(loads: IntArray, others: IntArray) -> BoolArray:
    """Which of the loads (n,) are among the others (m,), both ascending."""
    return places(loads, others) >= 0


@compiled
def farthest(moved: Array, bearing: IntArray) -> float:
    """max |u_j| of some (k,) of the displacements (m, dim), 0 of none."""
    most = 0.0
    for j in bearing:
        square = 0.0
        for a in range(moved.shape[1]):
            square += moved[j, a] * moved[j, a]
        most = max(most, square)
    return np.sqrt(most)


@compiled
def among(G: Floats, loads: IntArray, dim: int) -> Floats:
    """G (n*dim, n*dim) among some of the loads (n,)."""
    n = len(loads)
    result = np.empty((n * dim, n * dim), G.dtype)
    for i in range(n):
        for a in range(dim):
            row, into = G[loads[i] * dim + a], result[i * dim + a]
            for j in range(n):
                for b in range(dim):
                    into[j * dim + b] = row[loads[j] * dim + b]
    return result


@compiled
def carried(F: Array, c: Floats) -> Floats:
    """F_i c_i (k*dim, n) of c (k*dim, n)."""
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
def gathered(load: IntArray, w: Array, c: Floats) -> Floats:
    """w . c (r, n) of directions w (r, dim), each at one of the loads, and c (k*dim, n)."""
    r, dim = w.shape
    result = np.zeros((r, c.shape[1]), c.dtype)
    for at in range(r):
        into = result[at]
        for b in range(dim):
            share, row = w[at, b], c[load[at] * dim + b]
            for column in range(len(into)):
                into[column] += share * row[column]
    return result


@compiled
def spread(load: IntArray, w: Array, y: Floats, size: int) -> Floats:
    """sum w y (size, n) of y (r, n): the transpose of `gathered`, size = k*dim."""
    r, dim = w.shape
    result = np.zeros((size, y.shape[1]), y.dtype)
    for at in range(r):
        for b in range(dim):
            share, into = w[at, b], result[load[at] * dim + b]
            for column in range(len(into)):
                into[column] += share * y[at, column]
    return result


@compiled
def carried_along(given: Array, force: Array, position: Array, basis_gradient: Array) -> tuple[Array, Array]:
    """dx + dF v and dF^T f, both (n*dim, n_rows*dim), of n loads.

    given: v, force: f (n, dim); position: dx (n, dim, n_rows*dim); basis_gradient: dU (n, n_rows, dim), so that dF_aj =
    sum_r drow_ra dU_rj.
    """
    n, n_rows, dim = basis_gradient.shape
    carried, turned = np.empty((n * dim, n_rows * dim)), np.empty((n * dim, n_rows * dim))
    for i in range(n):
        for a in range(dim):
            carried[i * dim + a] = position[i, a]
        for r in range(n_rows):
            along = 0.0
            for j in range(dim):
                slope = basis_gradient[i, r, j]
                along += slope * given[i, j]
                for b in range(dim):
                    turned[i * dim + j, r * dim + b] = slope * force[i, b]
            for a in range(dim):
                carried[i * dim + a, r * dim + a] += along
    return carried, turned


@compiled
def add_basis(basis: Array, index: IntArray, moved: Array) -> None:
    """Adds U (x) I of some points (m,) to the derivatives of what is added to U rows, (m, dim, n_rows, dim)."""
    _, dim, n_rows, _ = moved.shape
    for k, i in enumerate(index):
        for a in range(dim):
            for r in range(n_rows):
                moved[k, a, r, a] += basis[i, r]


@summing
def felt(basis: Array, gradients: Array, index: IntArray, force: Array, given: Array) -> Array:
    """sum_j (U_j + v_j . grad U_j) (x) f_j (n_rows, dim) of forces f on some of the points (m,), which keep v, both (m,
    dim); basis U (n, n_rows), gradients (n, dim, n_rows)."""
    n_rows, dim = basis.shape[1], force.shape[1]
    total, along = np.zeros((dim, n_rows)), np.empty(n_rows)
    for j, point in enumerate(index):
        row = basis[point]
        for r in range(n_rows):
            along[r] = row[r]
        for k in range(dim):
            slope, share = gradients[point, k], given[j, k]
            for r in range(n_rows):
                along[r] += share * slope[r]
        for a in range(dim):
            into, share = total[a], force[j, a]
            for r in range(n_rows):
                into[r] += share * along[r]
    return np.ascontiguousarray(total.T)
