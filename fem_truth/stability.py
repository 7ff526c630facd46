"""Is an equilibrium stable? The lowest Ritz value of the Hessian on the null space, by preconditioned Lanczos."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from fem_truth.block_matrix import BlockMatrix, block_diagonal, spd_inverse
from fem_truth.null_space import NullSpace

# The lowest mode of the 60,000-cell jelly has settled to two digits after about 100 steps; its sign much sooner.
LANCZOS_STEPS = 120


def smallest_ritz_value(hessian: BlockMatrix, null_space: NullSpace, steps: int = LANCZOS_STEPS) -> float:
    """Lowest Ritz value of P H P relative to the block diagonal of H (made positive): dimensionless.

    By Sylvester's law its sign is that of the lowest eigenvalue of H itself, and it bounds the lowest relative
    eigenvalue from above: a negative value proves instability. The start vector is fixed, so the answer is too.
    """
    matrix, low_rank = hessian.sparse(), hessian.low_rank
    preconditioner = block_diagonal(spd_inverse(hessian.diagonal_blocks()))
    shape = (hessian.n_nodes, hessian.blocks.shape[1])
    r = null_space.project(np.random.default_rng(0).standard_normal(shape))
    previous = np.zeros(shape)
    diagonal: list[float] = []
    off_diagonal: list[float] = []
    beta = 0.0
    for _ in range(steps):
        z = null_space.project((preconditioner @ r.ravel()).reshape(shape))
        norm = float(np.sqrt(np.vdot(r, z)))
        if diagonal:
            if norm <= 1e-10 * abs(diagonal[0]):
                break  # the Krylov space is complete: a tiny body
            off_diagonal.append(norm)
        beta = norm
        v, z = r / beta, z / beta
        product = (matrix @ z.ravel()).reshape(shape)
        for weights, stiffness in low_rank:
            product += stiffness * weights[:, None] * (weights @ z)
        alpha = float(np.vdot(z, product))
        diagonal.append(alpha)
        r = (
            null_space.project(product) - alpha * v - beta * previous
            if len(diagonal) > 1
            else (null_space.project(product) - alpha * v)
        )
        previous = v
    return float(
        eigvalsh_tridiagonal(np.array(diagonal), np.array(off_diagonal), select="i", select_range=(0, 0))[0]
    )
