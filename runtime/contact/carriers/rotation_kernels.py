"""Compiled kernels of the rotations at points and of their first derivatives (`point_rotations.py`)."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.rotations import rotation_dofs, skew
from softprint.runtime.compiled import compiled

#: E (n, dim, dim) in 2D and 3D.
GENERATORS = {dim: np.array([skew(axis) for axis in np.eye(rotation_dofs(dim))]) for dim in (2, 3)}
#: sym(E_k E_l) (n*n, dim*dim) in 2D and 3D.
SQUARES = {
    dim: 0.5 * (np.einsum("kab,lbc->klac", E, E) + np.einsum("lab,kbc->klac", E, E)).reshape(len(E) ** 2, -1)
    for dim, E in GENERATORS.items()
}


def _by_eigenvalues(R: Array, F: Array, least: float) -> tuple[Array, Array]:
    E = GENERATORS[F.shape[1]]
    S = np.swapaxes(R, 1, 2) @ F
    S = 0.5 * (S + np.swapaxes(S, 1, 2))
    values, axes = np.linalg.eigh(np.einsum("kab,lac,mbc->mkl", E, E, S))
    return S, (axes / np.maximum(values, least)[:, None]) @ np.swapaxes(axes, 1, 2)


@compiled(reference=_by_eigenvalues)
def stretches(R: Array, F: Array, least: float) -> tuple[Array, Array]:
    """S (m, dim, dim), and K^-1 (m, n, n) with the eigenvalues of K at least `least`, of rotations R and deformation
    gradients F (m, dim, dim). In 3D, K is tr(S) I - S."""
    m, dim, _ = F.shape
    n = 1 if dim == 2 else 3
    S, inverse, K = np.empty((m, dim, dim)), np.empty((m, n, n)), np.empty((n, n))
    for j in range(m):
        trace = 0.0
        for a in range(dim):
            for b in range(dim):
                one = other = 0.0
                for c in range(dim):
                    one += R[j, c, a] * F[j, c, b]
                    other += R[j, c, b] * F[j, c, a]
                S[j, a, b] = 0.5 * (one + other)
            trace += S[j, a, a]
        if n == 1:
            inverse[j, 0, 0] = 1.0 / max(trace, least)
            continue
        for k in range(n):
            for i in range(n):
                K[k, i] = (trace if k == i else 0.0) - S[j, k, i]
        a, b, c = K[0, 0] - least, K[1, 1] - least, K[2, 2] - least
        minor = a * b - K[0, 1] * K[0, 1]
        d = (
            c * minor
            - K[1, 2] * (a * K[1, 2] - K[0, 1] * K[0, 2])
            + K[0, 2] * (K[0, 1] * K[1, 2] - b * K[0, 2])
        )
        if a > 0.0 and minor > 0.0 and d > 0.0:  # all eigenvalues are greater
            determinant = 0.0
            for k in range(n):
                p, q = (k + 1) % 3, (k + 2) % 3
                for i in range(n):
                    r, s = (i + 1) % 3, (i + 2) % 3
                    inverse[j, k, i] = K[p, r] * K[q, s] - K[p, s] * K[q, r]
                determinant += K[0, k] * (K[1, p] * K[2, q] - K[1, q] * K[2, p])
            for k in range(n):
                for i in range(n):
                    inverse[j, k, i] /= determinant
            continue
        values, axes = np.linalg.eigh(K)
        for k in range(n):
            for i in range(n):
                inverse[j, k, i] = 0.0
                for r in range(n):
                    inverse[j, k, i] += axes[k, r] * axes[i, r] / max(values[r], least)
    return S, inverse


def _by_turned(R: Array, inverse: Array, moments: Array) -> Array:
    T = R[:, None] @ GENERATORS[R.shape[1]]
    return np.einsum("mkcd,mkl,mlab,mab->mcd", T, inverse, T, moments)


@compiled(reference=_by_turned)
def pulled_back(R: Array, inverse: Array, moments: Array) -> Array:
    """d(M : R)/dF (m, dim, dim) of moments M, with K^-1 (m, n, n)."""
    m, dim, _ = R.shape
    n = 1 if dim == 2 else 3
    found, B, Pi = np.empty(R.shape), np.empty((dim, dim)), np.empty((dim, dim))
    turned, p = np.empty(n), np.empty(n)
    for j in range(m):
        for a in range(dim):
            for b in range(dim):
                B[a, b] = 0.0
                for c in range(dim):
                    B[a, b] += R[j, c, a] * moments[j, c, b]
        # E_k : R^T M, and Pi = sum_k p_k E_k; the generator k of a rotation turns axis r to axis s.
        for k in range(n):
            r, s = (0, 1) if n == 1 else ((k + 1) % 3, (k + 2) % 3)
            turned[k] = B[s, r] - B[r, s]
        Pi[:] = 0.0
        for k in range(n):
            p[k] = 0.0
            for i in range(n):
                p[k] += inverse[j, k, i] * turned[i]
            r, s = (0, 1) if n == 1 else ((k + 1) % 3, (k + 2) % 3)
            Pi[s, r], Pi[r, s] = p[k], -p[k]
        for a in range(dim):
            for b in range(dim):
                along = 0.0
                for c in range(dim):
                    along += R[j, a, c] * Pi[c, b]
                found[j, a, b] = along
    return found
