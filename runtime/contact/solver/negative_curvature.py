"""A descent direction of the contact energy where it is not convex, as where a point is about to slide off a tip.

With the curvature of a collider the contact stiffness D (`contact_solve.py`) is indefinite, and the Hessian of E over
the forces phi, G + G D G, can be so too: one equilibrium ends there, and the way to the next goes along the direction
of negative curvature, where Newton's step would go uphill. With the imbalance r = phi - phi(v), Newton's step solves

    (I + D G) dphi = -r,

whose matrix is symmetric in the inner product a . G b. Conjugate gradients in it give directions p_i that are
conjugate, so that E is to second order a sum over them, with curvatures k_i = G p_i . (I + D G) p_i. Newton's step goes
rho_i / k_i along each. With |k_i| in its place, and at least a share of p_i . G p_i, it goes down along all of them:
Newton's step modified (Nocedal and Wright 2006, chapter 3.4) in the basis of conjugate gradients, which sees the
directions that matter first. A product with G is all that an iteration costs, and no factor or eigenvalue is needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import summing

# Steps along flat directions are at most this much longer than Newton's along those of the compliance alone.
_FLOOR = 0.01
# Ends when the imbalance is this fraction of that at the start, in the norm of G. It is only a direction.
_TOLERANCE = 1e-4


def modified_newton_change(
    compliance: NDArray[np.floating[Any]], F: Array, stiffness: Array, phi: Array, balanced: Array
) -> Array:
    """The change dphi (m, dim) of the forces phi (m, dim), a descent direction of E. compliance: G (m*dim, m*dim);
    stiffness: D (m, dim, dim) in the world, zero at points without contact; balanced: phi(v) (m, dim), the contact
    forces at the displacements of phi."""
    D = np.einsum("jab,jac,jcd->jbd", F, stiffness, F)
    return _modified_step(compliance, D, phi - balanced, _TOLERANCE, _FLOOR)


@summing
def _modified_step(
    G: NDArray[np.floating[Any]], D: Array, imbalance: Array, tolerance: float, floor: float
) -> Array:
    """dphi (m, dim) by modified conjugate gradients; imbalance: r (m, dim)."""
    m, dim = imbalance.shape
    n = m * dim
    change, left = np.zeros(n), -imbalance.copy().reshape(n)
    displaced = _product(G, left)  # G times what is left
    rho = np.sum(left * displaced)
    enough = tolerance**2 * rho
    p, Gp = left.copy(), displaced.copy()
    for _ in range(n):
        if not rho > enough:
            break
        Ap = p.copy()
        for j in range(m):
            for a in range(dim):
                for b in range(dim):
                    Ap[j * dim + a] += D[j, a, b] * Gp[j * dim + b]
        curvature = np.sum(Gp * Ap)
        change += rho / max(abs(curvature), floor * np.sum(p * Gp)) * p
        if curvature == 0.0:
            break
        left -= rho / curvature * Ap
        displaced = _product(G, left)
        before, rho = rho, np.sum(left * displaced)
        p, Gp = left + rho / before * p, displaced + rho / before * Gp
    return change.reshape(m, dim)


@summing
def _product(G: NDArray[np.floating[Any]], phi: Array) -> Array:
    """G phi (n,)."""
    n = len(phi)
    result = np.empty(n)
    for i in range(n):
        row, entry = G[i], 0.0
        for j in range(n):
            entry += row[j] * phi[j]
        result[i] = entry
    return result
