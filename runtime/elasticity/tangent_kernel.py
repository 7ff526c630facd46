"""Compiled tangent of a material whose energy is a function of I_C = F:F and J = det F."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled


def _in_products(F: Array, C: Array, a: Array, b: Array, c: Array, d: Array) -> Array:
    """A of `isotropic_tangent`, with d2J/dF_ij dF_kl = e_ikm e_jln F_mn in 3D, e_ik e_jl in 2D, e the Levi-Civita
    symbol."""
    identity = np.eye(F.shape[1])
    if len(identity) == 3:
        e = np.cross(identity[:, None], identity)
        second = np.einsum("ikm,jln,cmn->cijkl", e, e, F)
    else:
        e = np.array([[0.0, 1.0], [-1.0, 0.0]])
        second = np.broadcast_to(np.einsum("ik,jl->ijkl", e, e), (len(F), 2, 2, 2, 2))
    A = np.einsum("c,ik,jl->cijkl", a, identity, identity) + np.einsum("c,cij,ckl->cijkl", b, F, F)
    return A + np.einsum("c,cij,ckl->cijkl", c, C, C) + np.einsum("c,cijkl->cijkl", d, second)


@compiled(reference=_in_products)
def isotropic_tangent(
    F: Array, cofactor: Array, identity: Array, outer: Array, outer_cofactor: Array, curvature: Array
) -> Array:
    """A_ijkl = a delta_ik delta_jl + b F_ij F_kl + c C_ij C_kl + d d2J/dF_ij dF_kl, (n, dim, dim, dim, dim), with
    C = dJ/dF the cofactor (n, dim, dim). The coefficients a, b, c, d (n,) are the last four arguments, in order."""
    n, dim, _ = F.shape
    A = np.empty((n, dim, dim, dim, dim))
    for c in range(n):
        for i in range(dim):
            for j in range(dim):
                for k in range(dim):
                    for l in range(dim):  # noqa: E741
                        A[c, i, j, k, l] = (
                            outer[c] * F[c, i, j] * F[c, k, l]
                            + outer_cofactor[c] * cofactor[c, i, j] * cofactor[c, k, l]
                        )
                A[c, i, j, i, j] += identity[c]
        # d2J/dF_ij dF_kl = e_ikm e_jln F_mn in 3D, e_ik e_jl in 2D.
        for i in range(dim):
            for j in range(dim):
                if dim == 2:
                    A[c, i, j, 1 - i, 1 - j] += curvature[c] if i == j else -curvature[c]
                else:
                    p, q, r, s = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
                    A[c, i, j, p, r] += curvature[c] * F[c, q, s]
                    A[c, i, j, q, s] += curvature[c] * F[c, p, r]
                    A[c, i, j, p, s] -= curvature[c] * F[c, q, r]
                    A[c, i, j, q, r] -= curvature[c] * F[c, p, s]
    return A
