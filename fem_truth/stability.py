"""Is an equilibrium stable? The lowest Ritz value of the Hessian on the null space, by preconditioned
Lanczos."""

from __future__ import annotations

import numpy as np

from fem_truth.block_matrix import BlockMatrix
from fem_truth.null_space import NullSpace
from fem_truth.small_blocks import block_diagonal, inverse_square_roots
from runtime.arrays import Array

# The lowest mode of the 60,000-cell jelly has settled to two digits after about 100 steps, its sign much
# sooner.
LANCZOS_STEPS = 120


def smallest_ritz_value(hessian: BlockMatrix, null_space: NullSpace, steps: int = LANCZOS_STEPS) -> float:
    """Lowest Ritz value of S H S on {y: S y in the null space}, S = |D|^(-1/2), D the block diagonal of H.

    Dimensionless; about 0.01 for a soft body at rest. By Sylvester's law its sign is that of the lowest
    eigenvalue of H on the null space, and it bounds the lowest eigenvalue of S H S from above: a negative
    value proves instability. The start vector is fixed, so the answer is reproducible.
    """
    n, dim = hessian.n_nodes, hessian.dim
    scaling = block_diagonal(inverse_square_roots(hessian.diagonal_blocks()))
    mask = np.repeat(null_space.free, dim).astype(float)
    # In the scaled unknowns y the constraint Q^T (S y) = 0 couples the coordinates: one column for each pair.
    constraint, _ = np.linalg.qr(scaling @ np.kron(null_space.orthonormal_basis, np.eye(dim)))

    def project(y: Array) -> Array:
        y = y * mask
        return y - constraint @ (constraint.T @ y)

    space = int(mask.sum()) - constraint.shape[1]
    basis = np.empty((min(steps, space), n * dim))
    diagonal: list[float] = []
    off_diagonal: list[float] = []
    r = project(np.random.default_rng(0).standard_normal(n * dim))
    for k in range(len(basis)):
        norm = float(np.linalg.norm(r))
        if k > 0:
            if norm < 1e-10:  # the entries of S H S are of order one
                break  # the Krylov space is complete: a tiny or a symmetric body
            off_diagonal.append(norm)
        basis[k] = r / norm
        product = scaling @ hessian.apply((scaling @ basis[k]).reshape(n, dim)).ravel()
        diagonal.append(float(basis[k] @ product))
        r = project(product)
        for _ in range(2):  # against all vectors so far, or ghosts of converged values appear
            r = r - basis[: k + 1].T @ (basis[: k + 1] @ r)
    # numpy's solver reads the lower triangle only.
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off_diagonal, -1))[0])
