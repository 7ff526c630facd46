"""The linear systems of loads in balance, compiled: one iteration of `ContactProblem`, and what `WoodburyFactor` is
made of.

All is in rest coordinates: loads phi = F^T f, displacements v = F^-1 u = G phi, normals F^T g. At the loads that bear
pressure the stiffening D = S g g^T - p H is taken apart into principal directions, D = sum_c l_c w_c w_c^T. Few of them
matter: that across the surface, and others where the collider is curved or the pressure high. With V = F^T W,

    (I + G F^T D F)^-1 r = r - G V K^-1 V^T r,    K = L^-1 + V^T G V    (Woodbury),

so that a system has as many unknowns as there are such directions, and is symmetric.

G (m*dim, m*dim) [m/N] is the compliance, in any precision, k (m,) [N/m^2] the stiffness, e (m,) [m] the penetrations
that are left, s = value (m,), g = gradient (m, dim), H = hessian (m, dim, dim) those of the signed distance at the
displaced loads. Formulas: `contact_solve.py`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.compiled import summing

Floats = NDArray[np.floating[Any]]

# Of an iteration: directions that change what they meet by less than this share are left out of the linear system, not
# of the balance that it is solved for.
_SLIGHT = 0.03
_SWEEPS = 12


@summing
def product(G: Floats, phi: Array) -> Array:
    """G phi (n, dim) of loads (m, dim); G (n*dim, m*dim)."""
    dim = phi.shape[1]
    flat, result = phi.ravel(), np.empty(len(G))
    for row in range(len(G)):
        column, total = G[row], 0.0
        for at in range(len(flat)):
            total += column[at] * flat[at]
        result[row] = total
    return result.reshape(-1, dim)


@summing
def pulled_back(F: Array, weight: Array, vectors: Array) -> Array:
    """F^T (weight g) (m, dim) of vectors g (m, dim), with weight (m,)."""
    m, dim = vectors.shape
    result = np.empty((m, dim))
    for j in range(m):
        for b in range(dim):
            entry = 0.0
            for a in range(dim):
                entry += F[j, a, b] * vectors[j, a]
            result[j, b] = weight[j] * entry
    return result


@summing
def moved_by(F: Array, v: Array) -> Array:
    """F v (m, dim)."""
    m, dim = v.shape
    result = np.empty((m, dim))
    for j in range(m):
        for a in range(dim):
            entry = 0.0
            for b in range(dim):
                entry += F[j, a, b] * v[j, b]
            result[j, a] = entry
    return result


@summing
def energy(k: Array, phi: Array, v: Array, left: Array) -> float:
    """E [J] = 1/2 phi . v + sum k max(0, left)^3 / 3 of loads phi and what they move (m, dim)."""
    work = penalty = 0.0
    for j in range(len(k)):
        for a in range(phi.shape[1]):
            work += phi[j, a] * v[j, a]
        e = max(left[j], 0.0)
        penalty += k[j] * e * e * e
    return 0.5 * work + penalty / 3.0


@summing
def balance(
    G: Floats, F: Array, k: Array, e: Array, v: Array, value: Array, gradient: Array
) -> tuple[Array, Array, Array, float]:
    """e with that of loads that bear nothing, which follow the distance; pressure p (m,); lag = v - G phi (m, dim); and
    the residual [m], the largest of |F lag| and, where pressure is borne, |e + s|."""
    m = len(v)
    e, pressure = e.copy(), np.empty(m)
    residual = 0.0
    for j in range(m):
        if e[j] > 0.0:
            residual = max(residual, abs(e[j] + value[j]))
        else:
            e[j] = -value[j]
        pressure[j] = k[j] * max(e[j], 0.0) ** 2
    lag = v - product(G, pulled_back(F, pressure, gradient))
    # A load that left for infinity makes all of them nan, which no comparison would show.
    if not np.isfinite(lag.sum()):
        return e, pressure, lag, np.inf
    return e, pressure, lag, max(residual, np.abs(moved_by(F, lag)).max())


@summing
def _diagonalise(A: Array, W: Array) -> None:
    """Jacobi's method: A (dim, dim), symmetric, becomes its eigenvalues, W the eigenvectors by column."""
    dim = len(A)
    for a in range(dim):
        for b in range(dim):
            W[a, b] = 1.0 if a == b else 0.0
    for _ in range(_SWEEPS):
        beside = total = 0.0
        for a in range(dim):
            total += A[a, a] ** 2
            for b in range(a):
                beside += A[a, b] ** 2
        if beside <= 1e-30 * total:
            break
        for a in range(dim):
            for b in range(a):
                if A[a, b] == 0.0:
                    continue
                half = 0.5 * (A[b, b] - A[a, a]) / A[a, b]
                t = (1.0 if half >= 0.0 else -1.0) / (abs(half) + np.sqrt(half * half + 1.0))
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for i in range(dim):
                    x, y = A[i, a], A[i, b]
                    A[i, a], A[i, b] = c * x - s * y, s * x + c * y
                for i in range(dim):
                    x, y = A[a, i], A[b, i]
                    A[a, i], A[b, i] = c * x - s * y, s * x + c * y
                    x, y = W[i, a], W[i, b]
                    W[i, a], W[i, b] = c * x - s * y, s * x + c * y


@summing
def directions(
    G: Floats,
    F: Array,
    bearing: IntArray,
    k: Array,
    e: Array,
    pressure: Array,
    gradient: Array,
    hessian: Array,
    least: float,
) -> tuple[IntArray, Array, Array, Array]:
    """The principal directions of D at the loads `bearing` (n,) with |l| v . G_jj v > least: of which load each is,
    numbered as G is, (r,), l (r,) [N/m], w and v = F^T w (r, dim)."""
    n, dim = len(bearing), gradient.shape[1]
    load, stiff = np.empty(n * dim, dtype=np.int64), np.empty(n * dim)
    w, v = np.empty((n * dim, dim)), np.empty((n * dim, dim))
    D, W, r = np.empty((dim, dim)), np.empty((dim, dim)), 0
    for j in bearing:
        S = 2.0 * k[j] * e[j]
        for a in range(dim):
            for b in range(dim):
                # A distance that is interpolated has Hessians that are symmetric only up to rounding.
                curved = 0.5 * (hessian[j, a, b] + hessian[j, b, a])
                D[a, b] = S * gradient[j, a] * gradient[j, b] - pressure[j] * curved
        _diagonalise(D, W)
        for c in range(dim):
            for b in range(dim):
                v[r, b] = 0.0
                for a in range(dim):
                    v[r, b] += F[j, a, b] * W[a, c]
            given = 0.0
            for a in range(dim):
                for b in range(dim):
                    given += v[r, a] * G[j * dim + a, j * dim + b] * v[r, b]
            if abs(D[c, c]) * given > least:
                load[r], stiff[r] = j, D[c, c]
                for a in range(dim):
                    w[r, a] = W[a, c]
                r += 1
    return load[:r], stiff[:r], w[:r], v[:r]


@summing
def saddle(G: Floats, load: IntArray, stiff: Array, v: Array) -> tuple[Floats, Floats]:
    """V^T G (r, m*dim) and K = L^-1 + V^T G V (r, r), in the precision of v."""
    r, dim = v.shape
    given, K = np.zeros((r, G.shape[1]), v.dtype), np.empty((r, r), v.dtype)
    for c in range(r):
        row = given[c]
        for a in range(dim):
            column, share = G[load[c] * dim + a], v[c, a]
            for at in range(len(row)):
                row[at] += share * column[at]
        for d in range(c + 1):
            entry = row[load[d] * dim] * v[d, 0]
            for b in range(1, dim):
                entry += row[load[d] * dim + b] * v[d, b]
            K[c, d] = K[d, c] = entry
        K[c, c] += 1.0 / stiff[c]
    return given, K


@summing
def _reacting(G: Floats, load: IntArray, stiff: Array, v: Floats, right: Array) -> Array:
    """F^T D F dv (m, dim) where (I + G F^T D F) dv = right (m, dim), of the directions `load`, l and v of D, solved in
    the precision of v."""
    r, dim = v.shape
    reacting = np.zeros(right.shape)
    if r == 0:
        return reacting
    K = saddle(G, load, stiff, v)[1]
    along = np.zeros(r, v.dtype)
    for c in range(r):
        for a in range(dim):
            along[c] += v[c, a] * right[load[c], a]
    y = np.linalg.solve(K, along)
    for c in range(r):
        for a in range(dim):
            reacting[load[c], a] += v[c, a] * y[c]
    return reacting


@summing
def step(
    G: Floats,
    F: Array,
    k: Array,
    e: Array,
    pressure: Array,
    v: Array,
    lag: Array,
    value: Array,
    gradient: Array,
    hessian: Array,
) -> tuple[Array, Array]:
    """The next v and e, linearised in both: with n = F^T g, dv = -lag + G (S n de + p F^T H F dv) and de = -(e + s) -
    n . dv,

        (I + G F^T D F) dv = -lag - G S n (e + s)    at the loads that bear pressure.

    Raises numpy.linalg.LinAlgError where a load is just about to slide off a tip.
    """
    m, dim = v.shape
    bearing = np.flatnonzero(e > 0.0)
    pushed = np.zeros(m)
    for j in bearing:
        pushed[j] = 2.0 * k[j] * e[j] * (e[j] + value[j])
    right = -lag - product(G, pulled_back(F, pushed, gradient))
    load, stiff, _, v_c = directions(G, F, bearing, k, e, pressure, gradient, hessian, _SLIGHT)
    # In the precision of G, single as a rule, for the next iteration puts right what this one is off by.
    dv = right - product(G, _reacting(G, load, stiff, v_c.astype(G.dtype), right))
    moved, e = moved_by(F, dv), e.copy()
    for j in bearing:
        e[j] = -value[j]
        for a in range(dim):
            e[j] -= gradient[j, a] * moved[j, a]
    return v + dv, e


@summing
def descent(
    G: Floats,
    F: Array,
    k: Array,
    e: Array,
    pressure: Array,
    phi: Array,
    balanced: Array,
    lag: Array,
    gradient: Array,
    hessian: Array,
) -> tuple[Array, Array, float]:
    """A change of the loads phi (m, dim), what it moves (m, dim), and how fast the energy changes along it: Newton's
    step on E(phi) from phi, with `balanced` what phi leads to."""
    bearing = np.flatnonzero(e > 0.0)
    load, stiff, _, v = directions(G, F, bearing, k, e, pressure, gradient, hessian, _SLIGHT)
    reacting = _reacting(G, load, stiff, v.astype(G.dtype), -lag)
    change = balanced - phi - reacting
    # What exactly this change moves, whatever the precision of it.
    along = -lag - product(G, reacting)
    return change, along, np.sum((phi - balanced) * along)
