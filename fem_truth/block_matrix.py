"""Sparse symmetric matrices of dim x dim blocks, and the two cheap things Newton's method adds to them.

scipy's BSR product took 0.85 ms where PETSc's BAIJ product took 2.3 ms (11,900 nodes, 167,000 blocks of 3 x
3, one core), and float32 gained nothing, so the inner iterations run here, in float64.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from runtime.arrays import Array, IntArray
from runtime.elasticity.determinant import cofactor, determinant


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Where the blocks are. row_starts (n+1,), columns (n_blocks,) in CSR order; diagonal (n,): block of (i,
    i)."""

    row_starts: IntArray
    columns: IntArray
    diagonal: IntArray

    @classmethod
    def from_csr(cls, row_starts: IntArray, columns: IntArray) -> BlockPattern:
        rows = np.repeat(np.arange(len(row_starts) - 1), np.diff(row_starts))
        return cls(row_starts, columns, np.flatnonzero(rows == columns))


@dataclass(eq=False)
class BlockMatrix:
    """A matrix over node vectors (n, dim). blocks: (n_blocks, dim, dim) on `pattern`, plus for each entry (w,
    k) of `low_rank` the rank-dim term k (w w^T) (x) I with w (n,): a spring that holds the w-weighted mean of
    the nodes."""

    pattern: BlockPattern
    blocks: Array
    low_rank: tuple[tuple[Array, float], ...] = ()

    @property
    def n_nodes(self) -> int:
        return len(self.pattern.diagonal)

    def sparse(self) -> sp.bsr_matrix:
        """The block part as a scipy matrix that shares the blocks."""
        size = self.n_nodes * self.blocks.shape[1]
        return sp.bsr_matrix(
            (self.blocks, self.pattern.columns, self.pattern.row_starts), shape=(size, size), copy=False
        )

    def apply(self, v: Array) -> Array:
        """The product with a node vector v (n, dim)."""
        product = np.asarray(self.sparse() @ v.ravel()).reshape(v.shape)
        for weights, stiffness in self.low_rank:
            product += stiffness * weights[:, None] * (weights @ v)
        return product

    def diagonal_blocks(self) -> Array:
        """(n, dim, dim), a copy, low-rank terms included."""
        diagonal = self.blocks[self.pattern.diagonal]
        identity = np.eye(self.blocks.shape[1])
        for weights, stiffness in self.low_rank:
            diagonal += (stiffness * weights**2)[:, None, None] * identity
        return diagonal

    def copy(self) -> BlockMatrix:
        return BlockMatrix(self.pattern, self.blocks.copy(), self.low_rank)

    def add_diagonal(self, index: IntArray, blocks: Array) -> None:
        """Add blocks (m, dim, dim), or scalars (m, 1, 1) times the identity, at the distinct nodes index
        (m,)."""
        if blocks.shape[1] == 1:
            blocks = blocks * np.eye(self.blocks.shape[1])
        self.blocks[self.pattern.diagonal[index]] += blocks

    def add_low_rank(self, weights: Array, stiffness: float) -> None:
        self.low_rank = (*self.low_rank, (weights, stiffness))


def spd_inverse(blocks: Array) -> Array:
    """Inverses of (n, dim, dim) symmetric blocks, made positive definite first where they are not.

    In a block that is indefinite the eigenvalues are replaced by their absolute values (at least 1e-3 of the
    largest one), the usual cure: a preconditioner has to be positive definite, and it decides nothing but the
    speed.
    """
    det, cofactors = determinant(blocks), cofactor(blocks)
    scale = np.trace(blocks, axis1=1, axis2=2) / blocks.shape[1]
    # Sylvester's criterion; in 2D the last cofactor is the first entry itself.
    positive = (
        (blocks[:, 0, 0] > 0) & (cofactors[:, -1, -1] > 0) & (det > 1e-9 * np.abs(scale) ** blocks.shape[1])
    )
    inverse = cofactors / np.where(positive, det, 1.0)[:, None, None]
    if not positive.all():
        values, vectors = np.linalg.eigh(blocks[~positive])
        inverse[~positive] = (vectors / _positive(values)[:, None, :]) @ vectors.transpose(0, 2, 1)
    return inverse


def inverse_square_roots(blocks: Array) -> Array:
    """|B|^(-1/2) of (n, dim, dim) symmetric blocks, with absolute eigenvalues as in `spd_inverse`."""
    values, vectors = np.linalg.eigh(blocks)
    return np.asarray((vectors / np.sqrt(_positive(values))[:, None, :]) @ vectors.transpose(0, 2, 1))


def positive_part(blocks: Array) -> Array:
    """The nearest positive semi-definite blocks to (n, dim, dim) symmetric ones."""
    values, vectors = np.linalg.eigh(blocks)
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1))


def _positive(values: Array) -> Array:
    """Eigenvalues (n, dim) made positive; 1 for a node that nothing holds, where any scaling will do."""
    values = np.abs(values)
    values = np.maximum(values, 1e-3 * values.max(axis=1, keepdims=True))
    return np.where(values > 0, values, 1.0)


def block_diagonal(blocks: Array) -> sp.bsr_matrix:
    """(n, dim, dim) blocks as a sparse block-diagonal matrix: three times faster to apply than einsum."""
    n, dim, _ = blocks.shape
    return sp.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(n * dim, n * dim), copy=False)
