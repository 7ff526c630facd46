"""One iteration of `LoadProblem`, and how its answer moves with the body, compiled: arrays are of some tens of loads.

G (m*dim, m*dim) [m/N] is the compliance, k (m,) [N/m^2] the stiffness, e (m,) [m] the penetrations that are left,
u = moved (m, dim) [m], and s = value (m,), g = gradient (m, dim), H = hessian (m, dim, dim) those of the signed
distance at the displaced loads. Formulas: `load_solve.py`.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.compiled import compiled


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
def turned(vectors: Array, matrices: Array, R: Array) -> tuple[Array, Array]:
    """R v and R A R^T of vectors (n, dim) and matrices (n, dim, dim)."""
    n, dim = vectors.shape
    v, A, half = np.zeros((n, dim)), np.zeros((n, dim, dim)), np.empty((dim, dim))
    for i in range(n):
        for a in range(dim):
            for b in range(dim):
                v[i, a] += R[a, b] * vectors[i, b]
                half[a, b] = 0.0
                for c in range(dim):
                    half[a, b] += R[a, c] * matrices[i, c, b]
        for a in range(dim):
            for b in range(dim):
                for c in range(dim):
                    A[i, a, b] += half[a, c] * R[b, c]
    return v, A


@compiled
def balance(
    G: Array, k: Array, e: Array, moved: Array, value: Array, gradient: Array
) -> tuple[Array, Array, Array, float]:
    """e with that of loads that bear nothing, which follow the distance; pressure p (m,); lag = u - G f (m, dim); and
    the residual [m], the largest of |lag| and, where pressure is borne, |e + s|."""
    m, dim = moved.shape
    e, pressure, force = e.copy(), np.empty(m), np.empty(m * dim)
    residual = 0.0
    for j in range(m):
        if e[j] > 0.0:
            residual = max(residual, abs(e[j] + value[j]))
        else:
            e[j] = -value[j]
        pressure[j] = k[j] * max(e[j], 0.0) ** 2
        for a in range(dim):
            force[j * dim + a] = pressure[j] * gradient[j, a]
    lag = moved - (G @ force).reshape(m, dim)
    # A load that left for infinity makes all of them nan, which no comparison would show.
    return e, pressure, lag, max(residual, np.abs(lag).max()) if np.isfinite(lag.sum()) else np.inf


@compiled
def stiffening(
    bearing: IntArray, k: Array, e: Array, pressure: Array, gradient: Array, hessian: Array
) -> Array:
    """D = S g g^T - p H (n, dim, dim) of the loads `bearing` (n,), S = 2 k e."""
    n, dim = len(bearing), gradient.shape[1]
    D = np.empty((n, dim, dim))
    for i in range(n):
        j = bearing[i]
        S = 2.0 * k[j] * e[j]
        for a in range(dim):
            for b in range(dim):
                D[i, a, b] = S * gradient[j, a] * gradient[j, b] - pressure[j] * hessian[j, a, b]
    return D


@compiled
def softening(among: Array, D: Array) -> Array:
    """I + G D (n*dim, n*dim) of G among n loads and D (n, dim, dim)."""
    size, dim = len(among), D.shape[1]
    product = np.zeros((size, size))
    for row in range(size):
        for j in range(len(D)):
            for a in range(dim):
                for b in range(dim):
                    product[row, j * dim + b] += among[row, j * dim + a] * D[j, a, b]
        product[row, row] += 1.0
    return product


@compiled
def among(G: Array, loads: IntArray, dim: int) -> Array:
    """G (n*dim, n*dim) among some of the loads (n,)."""
    n = len(loads)
    result = np.empty((n * dim, n * dim))
    for i in range(n):
        for a in range(dim):
            row, into = G[loads[i] * dim + a], result[i * dim + a]
            for j in range(n):
                for b in range(dim):
                    into[j * dim + b] = row[loads[j] * dim + b]
    return result


@compiled
def step(
    G: Array,
    k: Array,
    e: Array,
    pressure: Array,
    moved: Array,
    lag: Array,
    value: Array,
    gradient: Array,
    hessian: Array,
) -> tuple[Array, Array]:
    """The next u and e, linearised in both: with du = -lag + G (S g de + p H du) and de = -(e + s) - g . du,

        (I + G D) du = -lag - G S g (e + s)    at the loads that bear pressure.

    Raises numpy.linalg.LinAlgError where a load is just about to slide off a tip.
    """
    m, dim = moved.shape
    bearing = np.flatnonzero(e > 0.0)
    n = len(bearing)
    pushed, turned = np.zeros((m, dim)), np.zeros((m, dim))
    for j in bearing:
        pushed[j] = 2.0 * k[j] * e[j] * (e[j] + value[j]) * gradient[j]
    missing = lag + (G @ pushed.ravel()).reshape(m, dim)
    right = np.empty((n, dim))
    for i in range(n):
        right[i] = -missing[bearing[i]]
    D = stiffening(bearing, k, e, pressure, gradient, hessian)
    du = np.linalg.solve(softening(among(G, bearing, dim), D), right.ravel()).reshape(n, dim)
    e = e.copy()
    for i in range(n):
        j = bearing[i]
        de = -(e[j] + value[j]) - np.sum(gradient[j] * du[i])
        turned[j] = 2.0 * k[j] * e[j] * de * gradient[j] + pressure[j] * (hessian[j] @ du[i])
        e[j] += de
    return moved - lag + (G @ turned.ravel()).reshape(m, dim), e


@compiled
def carried_along(
    inverse_F: Array, moved: Array, force: Array, position: Array, basis_gradient: Array
) -> tuple[Array, Array]:
    """dx + dF v with v = F^-1 moved, and eta = F^-T dF^T f, both (n*dim, n_rows*dim), of n loads.

    inverse_F: F^-1 (n, dim, dim); moved, force (n, dim); position: dx (n, dim, n_rows*dim); basis_gradient: dU (n,
    n_rows, dim), so that dF_aj = sum_r drow_ra dU_rj.
    """
    n, n_rows, dim = basis_gradient.shape
    carried, eta = np.empty((n * dim, n_rows * dim)), np.empty((n * dim, n_rows * dim))
    turned = np.empty(dim)
    for i in range(n):
        for r in range(n_rows):
            along = 0.0  # dU v = (F^-T dU) moved
            for a in range(dim):
                turned[a] = 0.0
                for j in range(dim):
                    turned[a] += inverse_F[i, j, a] * basis_gradient[i, r, j]
                along += turned[a] * moved[i, a]
            for a in range(dim):
                for b in range(dim):
                    at = i * dim + a, r * dim + b
                    carried[at] = position[i, a, r * dim + b] + (along if a == b else 0.0)
                    eta[at] = turned[a] * force[i, b]
    return carried, eta
