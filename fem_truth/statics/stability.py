"""Stability of an equilibrium: the lowest Ritz value of the Hessian on the null space, by preconditioned
Lanczos."""

from __future__ import annotations

import numpy as np

from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.fem_truth.linalg.null_space import NullSpace, orthonormal
from softprint.fem_truth.linalg.small_blocks import block_diagonal, inverse_square_roots
from softprint.runtime.arrays import Array

# The lowest mode of the 60,000-cell jelly converges to two digits in about 100 steps, its sign much
# sooner.
LANCZOS_STEPS = 120


def smallest_ritz_value(hessian: BlockMatrix, null_space: NullSpace, steps: int = LANCZOS_STEPS) -> float:
    """Lowest Ritz value of S H S on {y: S y in the null space}, S = |D|^(-1/2), D the block diagonal of H.

    Dimensionless; about 0.01 for a soft body at rest. By Sylvester's law its sign is that of the lowest
    eigenvalue of H on the null space, and it bounds the lowest eigenvalue of S H S from above: a negative
    value proves instability. The start vector is fixed, so the result is reproducible.
    """
    share, own = null_space.share, null_space.share.owned
    n, dim = hessian.n_nodes, hessian.dim
    scaling = block_diagonal(inverse_square_roots(share.assembled(hessian.diagonal_blocks())))
    mask = null_space.free[:, None].astype(float)
    # In the scaled unknowns y the constraint Q^T (S y) = 0 couples the coordinates: one column for each pair.
    columns = scaling @ np.kron(null_space.orthonormal_basis, np.eye(dim))
    constraint = np.ascontiguousarray(orthonormal(columns.reshape(n, dim, -1), share))
    count = constraint.shape[-1]
    all_rows = constraint.reshape(n * dim, count)
    own_rows = constraint[own].reshape(mask[own].size * dim, count)

    def project(y: Array) -> Array:
        y = y * mask
        return y - (all_rows @ share.total(own_rows.T @ y[own].ravel())).reshape(n, dim)

    def scaled(y: Array) -> Array:
        return np.asarray(scaling @ y.ravel()).reshape(n, dim)

    space = round(share.total(float(mask[own].sum()))) * dim - count
    basis = np.empty((min(steps, space), mask[own].size * dim))  # of the nodes that this rank owns
    diagonal: list[float] = []
    off_diagonal: list[float] = []
    r = project(share.take(np.random.default_rng(0).standard_normal((share.n_nodes(mask), dim))))
    for k in range(len(basis)):
        norm = share.norm(r)
        if k > 0:
            if norm < 1e-10:  # the entries of S H S are of order one
                break  # the Krylov space is complete: a tiny or a symmetric body
            off_diagonal.append(norm)
        y = share.agreed(r / norm)
        basis[k] = y[own].ravel()
        product = scaled(share.assembled(hessian.apply(scaled(y))))
        diagonal.append(share.dot(y, product))
        r = product
        for _ in range(2):  # against all vectors so far; otherwise ghost copies of converged values appear
            within = share.total(basis[: k + 1] @ r[own].ravel())
            r[own] -= (basis[: k + 1].T @ within).reshape(-1, dim)
        # Last, because every step would amplify the remaining components in the range of the constraint.
        r = project(r)
    # numpy's solver reads the lower triangle only.
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off_diagonal, -1))[0])
