"""A descent direction of the contact energy where it is not convex, as where a point is about to slide off a tip.

With the curvature of a collider the contact stiffness D (`contact_solve.py`) is indefinite, and the Hessian of E over
the forces phi, G + G D G, can be so too: one equilibrium ends there, and the way to the next goes along the direction
of negative curvature, where Newton's step would go uphill. With G = L L^T, M = I + L^T D L = Q diag(l) Q^T and the
imbalance r = phi - phi(v), Newton's step is -L^-T M^-1 L^T r. Its modification by eigenvalues (Nocedal and Wright 2006,
section 3.4) puts m = max(|l|, floor) in the place of l. As (M - I) q = L^T D L q, it needs no inverse of L:

    dphi = -r + sum_i c_i D L q_i (q_i . L^T r),    c = (1 - 1/m) / (l - 1),

which is Newton's step where m = l, c = 1/l.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array

# Steps along flat directions are at most this much longer than Newton's along those of the compliance alone.
_FLOOR = 0.01
# The compliance among points between nodes is singular, and in single precision: its factor needs this share of the
# mean diagonal. It affects the direction and not the solution.
_SHIFT = 1e-6


def modified_newton_change(
    compliance: NDArray[np.floating[Any]], F: Array, stiffness: Array, phi: Array, balanced: Array
) -> Array:
    """The change dphi (m, dim) of the forces phi (m, dim), a descent direction of E. compliance: G (m*dim, m*dim);
    stiffness: D (m, dim, dim) in the world, zero at points without contact; balanced: phi(v) (m, dim), the contact
    forces at the displacements of phi."""
    m, dim = phi.shape
    D = np.einsum("jab,jac,jcd->jbd", F, stiffness, F)
    n = m * dim
    G = compliance.astype(np.float64)
    L = np.linalg.cholesky(G + _SHIFT * np.trace(G) / n * np.eye(n)).reshape(m, dim, n)
    DL = (D @ L).reshape(n, n)
    L = L.reshape(n, n)
    eigenvalue, Q = np.linalg.eigh(np.eye(n) + L.T @ DL)
    imbalance = (phi - balanced).ravel()
    along = Q.T @ (L.T @ imbalance)
    size = np.maximum(np.abs(eigenvalue), _FLOOR)
    # The limit at l = 1, where D L q = 0, does not matter.
    beyond = np.where(np.abs(eigenvalue - 1.0) > 1e-9, eigenvalue - 1.0, np.inf)
    change = -imbalance + DL @ (Q @ ((1.0 - 1.0 / size) / beyond * along))
    return np.asarray(change.reshape(m, dim))
