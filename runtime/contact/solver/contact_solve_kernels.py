"""Compiled linear systems of the contact solve: one iteration of `ContactProblem`, and the parts of `WoodburyFactor`.

Everything is in rest coordinates: forces phi = A^T f, displacements v = A^-1 u = G phi, normals A^T g. At the active
points the contact stiffness D = S g g^T - p H is decomposed into principal directions, D = sum_c l_c w_c w_c^T. Few of
them are significant: the one normal to the surface, and others where the collider is curved or the pressure high. With
V = A^T W,

    (I + G A^T D A)^-1 r = r - G V K^-1 V^T r,    K = L^-1 + V^T G V    (Woodbury 1950),

so that the system is symmetric and has one unknown for each significant direction.

G is the compliance among the m points [m/N], by that among the contact nodes and in its precision, k (m,) [N/m^2] the
stiffness, e (m,) [m] the penetrations, s = value (m,), g = gradient (m, dim), H = hessian (m, dim, dim) those of the
signed distance at the deformed positions. Formulas: `contact_solve.py`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import summing
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance

Floats = NDArray[np.floating[Any]]

# Principal directions that change a displacement by less than this fraction are left out of the linear system of an
# iteration. The residual includes all of them, so the solution is not affected.
_SLIGHT = 0.03
_SWEEPS = 12


@summing
def product(G: NodalCompliance, phi: Array) -> Array:
    """G phi (m, dim) [m] of forces phi (m, dim) [N]. Most points, and some nodes, bear no force."""
    among_nodes, corners, shares = G
    m, dim = phi.shape
    forces, moved, result = np.zeros(len(among_nodes)), np.zeros(len(among_nodes)), np.zeros((m, dim))
    for j in range(m):
        for b in range(dim):
            if phi[j, b] != 0.0:
                for a in range(corners.shape[1]):
                    forces[corners[j, a] * dim + b] += shares[j, a] * phi[j, b]
    for i, column in enumerate(among_nodes):
        force = forces[i]
        if force != 0.0:
            for at in range(len(moved)):
                moved[at] += force * column[at]
    for j in range(m):
        for a in range(corners.shape[1]):
            first, share = corners[j, a] * dim, shares[j, a]
            for b in range(dim):
                result[j, b] += share * moved[first + b]
    return result


@summing
def displacements_along(G: NodalCompliance, point: IntArray, v: Floats) -> Floats:
    """For the directions V of forces, v (r, dim), each on one of the points (r,): the displacements of the nodes by
    them (r, k*dim), in the precision of v."""
    among_nodes, corners, shares = G
    r, dim = v.shape
    moved = np.zeros((r, len(among_nodes)), v.dtype)
    for c in range(r):
        row = moved[c]
        for a in range(corners.shape[1]):
            first, share = corners[point[c], a] * dim, v.dtype.type(shares[point[c], a])
            for b in range(dim):
                column, force = among_nodes[first + b], share * v[c, b]
                for at in range(len(row)):
                    row[at] += force * column[at]
    return moved


@summing
def compliance_along(G: NodalCompliance, point: IntArray, v: Floats) -> Floats:
    """V^T G V (r, r), the compliance along the same directions, in their precision."""
    among_nodes, corners, shares = G
    (r, dim), per_point = v.shape, corners.shape[1]
    # The compliance among the nodes that they act on, numbered anew: these are fewer. (`submatrix` of
    # `surface_compliance_kernels.py` does the same for all nodes of some points, but is of another file.)
    number, nodes, n = np.full(len(among_nodes) // dim, -1), np.empty(len(among_nodes) // dim, np.int64), 0
    for c in range(r):
        for node in corners[point[c]]:
            if number[node] < 0:
                number[node], nodes[n] = n, node
                n += 1
    among = np.empty((n * dim, n * dim), v.dtype)
    for i in range(n):
        for a in range(dim):
            row, into = among_nodes[nodes[i] * dim + a], among[i * dim + a]
            for j in range(n):
                for b in range(dim):
                    into[j * dim + b] = row[nodes[j] * dim + b]
    # N V of the weights N, as sparse columns: at which rows, and what.
    rows = np.empty((per_point * dim, r), np.int32)
    entries = np.empty((per_point * dim, r), v.dtype)
    for c in range(r):
        for a in range(per_point):
            for b in range(dim):
                rows[a * dim + b, c] = number[corners[point[c], a]] * dim + b
                entries[a * dim + b, c] = v.dtype.type(shares[point[c], a]) * v[c, b]
    result, moved = np.zeros((r, r), v.dtype), np.empty(n * dim, v.dtype)
    for c in range(r):
        moved[:] = 0.0
        for part in range(len(rows)):
            column, force = among[rows[part, c]], entries[part, c]
            for at in range(n * dim):
                moved[at] += force * column[at]
        for part in range(len(rows)):
            of, along = rows[part], entries[part]
            for d in range(c + 1):
                result[c, d] += along[d] * moved[of[d]]
    for c in range(r):
        for d in range(c):
            result[d, c] = result[c, d]
    return result


@summing
def _alone(G: NodalCompliance, j: int, v: Array) -> float:
    """The compliance v . G_jj v [m/N] of one point along v (dim,)."""
    among_nodes, corners, shares = G
    dim, total = len(v), 0.0
    for p in range(corners.shape[1]):
        for q in range(corners.shape[1]):
            reached = 0.0
            for a in range(dim):
                for b in range(dim):
                    reached += v[a] * among_nodes[corners[j, p] * dim + a, corners[j, q] * dim + b] * v[b]
            total += shares[j, p] * shares[j, q] * reached
    return total


@summing
def pulled_back(A: Array, weight: Array, vectors: Array) -> Array:
    """A^T (weight g) (m, dim) of vectors g (m, dim), with weight (m,)."""
    m, dim = vectors.shape
    result = np.empty((m, dim))
    for j in range(m):
        for b in range(dim):
            entry = 0.0
            for a in range(dim):
                entry += A[j, a, b] * vectors[j, a]
            result[j, b] = weight[j] * entry
    return result


@summing
def to_world(A: Array, v: Array) -> Array:
    """A v (m, dim)."""
    m, dim = v.shape
    result = np.empty((m, dim))
    for j in range(m):
        for a in range(dim):
            entry = 0.0
            for b in range(dim):
                entry += A[j, a, b] * v[j, b]
            result[j, a] = entry
    return result


@summing
def energy(k: Array, phi: Array, v: Array, penetration: Array) -> float:
    """E [J] = 1/2 phi . v + sum k max(0, e)^3 / 3 of forces phi and their displacements (m, dim)."""
    work = penalty = 0.0
    for j in range(len(k)):
        for a in range(phi.shape[1]):
            work += phi[j, a] * v[j, a]
        e = max(penetration[j], 0.0)
        penalty += k[j] * e * e * e
    return 0.5 * work + penalty / 3.0


@summing
def balance(
    G: NodalCompliance, A: Array, k: Array, e: Array, v: Array, value: Array, gradient: Array
) -> tuple[Array, Array, Array, float]:
    """Penetrations e (m,), updated to -s at points without pressure; pressure p (m,); lag = v - G phi (m, dim); and the
    residual [m], the largest of |A lag| and, where there is pressure, |e + s|."""
    m = len(v)
    e, pressure = e.copy(), np.empty(m)
    residual = 0.0
    for j in range(m):
        if e[j] > 0.0:
            residual = max(residual, abs(e[j] + value[j]))
        else:
            e[j] = -value[j]
        pressure[j] = k[j] * max(e[j], 0.0) ** 2
    lag = v - product(G, pulled_back(A, pressure, gradient))
    # A diverged point makes all of them nan, for which every comparison is false.
    if not np.isfinite(lag.sum()):
        return e, pressure, lag, np.inf
    return e, pressure, lag, max(residual, np.abs(to_world(A, lag)).max())


@summing
def _diagonalise(A: Array, W: Array) -> None:
    """Jacobi's method, in place: the diagonal of the symmetric A (dim, dim) becomes its eigenvalues, the columns of W
    the eigenvectors."""
    dim = len(A)
    for a in range(dim):
        for b in range(dim):
            W[a, b] = 1.0 if a == b else 0.0
    for _ in range(_SWEEPS):
        off_diagonal = diagonal = 0.0
        for a in range(dim):
            diagonal += A[a, a] ** 2
            for b in range(a):
                off_diagonal += A[a, b] ** 2
        if off_diagonal <= 1e-30 * diagonal:
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
def stiffness_directions(
    G: NodalCompliance,
    A: Array,
    active: IntArray,
    k: Array,
    e: Array,
    pressure: Array,
    gradient: Array,
    hessian: Array,
    least: float,
) -> tuple[IntArray, Array, Array, Array]:
    """The principal directions of D at the points `active` (n,) with |l| v . G_jj v > least: the point (r,) of each,
    numbered as in G, its stiffness l (r,) [N/m], w and v = A^T w (r, dim)."""
    n, dim = len(active), gradient.shape[1]
    point, stiff = np.empty(n * dim, dtype=np.int64), np.empty(n * dim)
    w, v = np.empty((n * dim, dim)), np.empty((n * dim, dim))
    D, W, r = np.empty((dim, dim)), np.empty((dim, dim)), 0
    for j in active:
        S = 2.0 * k[j] * e[j]
        for a in range(dim):
            for b in range(dim):
                # The Hessian of an interpolated distance is symmetric only up to rounding.
                curved = 0.5 * (hessian[j, a, b] + hessian[j, b, a])
                D[a, b] = S * gradient[j, a] * gradient[j, b] - pressure[j] * curved
        _diagonalise(D, W)
        for c in range(dim):
            for b in range(dim):
                v[r, b] = 0.0
                for a in range(dim):
                    v[r, b] += A[j, a, b] * W[a, c]
            if abs(D[c, c]) * _alone(G, j, v[r]) > least:
                point[r], stiff[r] = j, D[c, c]
                for a in range(dim):
                    w[r, a] = W[a, c]
                r += 1
    return point[:r], stiff[:r], w[:r], v[:r]


@summing
def woodbury_matrix(G: NodalCompliance, point: IntArray, stiff: Array, v: Floats) -> Floats:
    """K = L^-1 + V^T G V (r, r), in the precision of v."""
    K = compliance_along(G, point, v)
    for c in range(len(stiff)):
        K[c, c] += 1.0 / stiff[c]
    return K


@summing
def linear_system(
    G: NodalCompliance,
    A: Array,
    k: Array,
    e: Array,
    pressure: Array,
    gradient: Array,
    hessian: Array,
    right: Array,
) -> tuple[IntArray, Floats, Floats, Floats]:
    """What (I + G A^T D A) dv = right (m, dim) takes, D of the active points: the directions V, `point` (r,) and v (r,
    dim), K (r, r) and V^T right (r,). It is in the precision of G, usually single: the next iteration corrects the
    rounding error of this one."""
    active = np.flatnonzero(e > 0.0)
    point, stiff, _, directions = stiffness_directions(
        G, A, active, k, e, pressure, gradient, hessian, _SLIGHT
    )
    v = directions.astype(G.among_nodes.dtype)
    projected = np.zeros(len(point), v.dtype)
    for c in range(len(point)):
        for a in range(v.shape[1]):
            projected[c] += v[c, a] * right[point[c], a]
    return point, v, woodbury_matrix(G, point, stiff, v), projected


@summing
def expanded(point: IntArray, v: Floats, y: Floats, m: int) -> Array:
    """V y (m, dim) of y (r,)."""
    r, dim = v.shape
    result = np.zeros((m, dim))
    for c in range(r):
        for a in range(dim):
            result[point[c], a] += v[c, a] * y[c]
    return result


@summing
def _newton_right_side(
    G: NodalCompliance, A: Array, k: Array, e: Array, lag: Array, value: Array, gradient: Array
) -> Array:
    """-lag - G S n (e + s) (m, dim), with n = A^T g: the right-hand side of `newton_step`."""
    pushed = np.zeros(len(k))
    for j in range(len(k)):
        if e[j] > 0.0:
            pushed[j] = 2.0 * k[j] * e[j] * (e[j] + value[j])
    return -lag - product(G, pulled_back(A, pushed, gradient))


@summing
def newton_system(
    G: NodalCompliance,
    A: Array,
    k: Array,
    e: Array,
    pressure: Array,
    lag: Array,
    value: Array,
    gradient: Array,
    hessian: Array,
) -> tuple[Array, IntArray, Floats, Floats, Floats]:
    """The right-hand side of `newton_step`, and its `linear_system`."""
    right = _newton_right_side(G, A, k, e, lag, value, gradient)
    point, v, K, projected = linear_system(G, A, k, e, pressure, gradient, hessian, right)
    return right, point, v, K, projected


@summing
def newton_step(
    G: NodalCompliance,
    A: Array,
    e: Array,
    v: Array,
    value: Array,
    gradient: Array,
    right: Array,
    point: IntArray,
    directions: Floats,
    y: Floats,
) -> tuple[Array, Array]:
    """One Newton step: the next v and e. With n = A^T g, linearising in both unknowns gives dv = -lag + G (S n de + p
    A^T H A dv) and de = -(e + s) - n . dv, so

        (I + G A^T D A) dv = -lag - G S n (e + s)    at the active points.

    right: the right-hand side (m, dim); A^T D A dv of the solution is V y, with `directions` (r, dim) V and y (r,).
    """
    dv = right - product(G, expanded(point, directions, y, len(v)))
    moved, e = to_world(A, dv), e.copy()
    for j in range(len(e)):
        if e[j] > 0.0:
            e[j] = -value[j]
            for a in range(len(moved[j])):
                e[j] -= gradient[j, a] * moved[j, a]
    return v + dv, e
