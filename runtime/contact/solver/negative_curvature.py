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

from collections.abc import Callable

import numpy as np

from softprint.runtime.arrays import Array

# Steps along flat directions are at most this much longer than Newton's along those of the compliance alone.
_FLOOR = 0.01
# Ends when the imbalance is this fraction of that at the start, in the norm of G. It is only a direction.
_TOLERANCE = 1e-4


def modified_newton_change(
    displaced_by: Callable[[Array], Array], F: Array, stiffness: Array, imbalance: Array
) -> Array:
    """The change dphi (m, dim) of the forces, a descent direction of E. displaced_by: the product with G of forces (m,
    dim); stiffness: D (m, dim, dim) in the world, zero at points without contact; imbalance: r (m, dim), the forces
    less the contact forces at the displacements of the forces."""
    D = np.einsum("jab,jac,jcd->jbd", F, stiffness, F)
    change, left = np.zeros_like(imbalance), -imbalance
    displaced = displaced_by(left)
    rho = float((left * displaced).sum())
    enough = _TOLERANCE**2 * rho
    p, Gp = left, displaced
    for _ in range(imbalance.size):
        if not rho > enough:
            break
        Ap = p + np.einsum("jab,jb->ja", D, Gp)
        curvature = float((Gp * Ap).sum())
        change += rho / max(abs(curvature), _FLOOR * float((p * Gp).sum())) * p
        if curvature == 0.0:
            break
        left = left - rho / curvature * Ap
        displaced = displaced_by(left)
        before, rho = rho, float((left * displaced).sum())
        p, Gp = left + rho / before * p, displaced + rho / before * Gp
    return change
