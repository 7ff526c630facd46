"""Block-Jacobi preconditioned conjugate gradients in the null space of the reduced basis (thesis 5.3.3,
[AB03]).

Minimises  1/2 d^T H d + g^T d  over d = P d. Stops early, as Steihaug's truncated Newton method does, where H
turns out to have negative curvature: the iterate so far is still a descent direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_truth.block_matrix import BlockMatrix, block_diagonal, spd_inverse
from fem_truth.null_space import NullSpace
from runtime.arrays import Array


@dataclass(frozen=True, eq=False)
class CgResult:
    """step: d (n, dim) [m]; slope: g^T d [J], negative; iterations; negative_curvature: seen on the way, with
    `direction` (n, dim) the offending p (None otherwise); residual: |P (H d + g)| / |g| reached."""

    step: Array
    slope: float
    iterations: int
    negative_curvature: bool
    direction: Array | None
    residual: float


def projected_cg(
    hessian: BlockMatrix, gradient: Array, null_space: NullSpace, tolerance: float, max_iterations: int
) -> CgResult:
    """Solve P H P d = -g to |residual| <= tolerance |g|. gradient: g = P g (n, dim)."""
    shape, project = gradient.shape, null_space.project
    matrix, low_rank = hessian.sparse(), hessian.low_rank
    preconditioner = block_diagonal(spd_inverse(hessian.diagonal_blocks()))

    step = np.zeros(shape)
    residual = -gradient
    target = tolerance * float(np.linalg.norm(gradient))
    z = project((preconditioner @ residual.ravel()).reshape(shape))
    p = z
    rho = float(np.vdot(residual, z))
    norm = float(np.linalg.norm(gradient))
    for iteration in range(1, max_iterations + 1):
        product = (matrix @ p.ravel()).reshape(shape)
        for weights, stiffness in low_rank:
            product += stiffness * weights[:, None] * (weights @ p)
        curvature = float(np.vdot(p, product))
        if curvature <= 0.0:
            descent = z if iteration == 1 else step
            return CgResult(descent, float(np.vdot(gradient, descent)), iteration, True, p, norm)
        alpha = rho / curvature
        step = step + alpha * p
        residual = residual - alpha * project(product)
        norm = float(np.linalg.norm(residual))
        if norm <= target:
            break
        z = project((preconditioner @ residual.ravel()).reshape(shape))
        rho, previous = float(np.vdot(residual, z)), rho
        p = z + (rho / previous) * p
    step = project(step)  # sweeps up the round-off that has drifted out of the null space
    scale = float(np.linalg.norm(gradient))
    return CgResult(
        step, float(np.vdot(gradient, step)), iteration, False, None, norm / scale if scale else 0.0
    )
