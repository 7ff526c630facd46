"""Functions of many small symmetric matrices, (n, dim, dim)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from softprint.runtime.arrays import Array


def absolute_inverses(blocks: Array) -> Array:
    """Positive definite approximate inverses of (n, dim, dim) symmetric blocks that may be indefinite.

    The eigenvalues are replaced by their absolute values (at least 1e-3 of the largest one): a preconditioner has to be
    positive definite, and it only affects the speed.
    """
    values, vectors = np.linalg.eigh(blocks)
    return np.asarray((vectors / _positive(values)[:, None, :]) @ vectors.transpose(0, 2, 1))


def inverse_square_roots(blocks: Array) -> Array:
    """|B|^(-1/2) of (n, dim, dim) symmetric blocks, with absolute eigenvalues as in `absolute_inverses`."""
    values, vectors = np.linalg.eigh(blocks)
    return np.asarray((vectors / np.sqrt(_positive(values))[:, None, :]) @ vectors.transpose(0, 2, 1))


def positive_part(blocks: Array) -> Array:
    """The nearest positive semi-definite blocks to (n, dim, dim) symmetric ones."""
    values, vectors = np.linalg.eigh(blocks)
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1))


def _positive(values: Array) -> Array:
    """Eigenvalues (n, dim) made positive; 1 for a node with a zero block, where any scaling will do."""
    values = np.abs(values)
    values = np.maximum(values, 1e-3 * values.max(axis=1, keepdims=True))
    return np.where(values > 0, values, 1.0)


def block_diagonal(blocks: Array) -> sp.bsr_matrix:
    """(n, dim, dim) blocks as a sparse block-diagonal matrix: three times faster to apply than einsum."""
    n, dim, _ = blocks.shape
    return sp.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(n * dim, n * dim), copy=False)
