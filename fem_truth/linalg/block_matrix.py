"""Sparse symmetric matrices of dim x dim blocks, with the two cheap updates that Newton's method needs.

The blocks above the diagonal come from elasticity alone. The other terms only change diagonal blocks (or are low-rank),
so matrices share the upper blocks and each has its own diagonal. Storing one triangle halves the memory and the time of
a product: 0.3 ms, where scipy's BSR product of both triangles takes 1 to 2 ms (12,400 nodes, 77,000 blocks above the
diagonal, one core).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from softprint.fem_truth.linalg.block_kernels import BlockKernels, Real
from softprint.fem_truth.linalg.small_blocks import block_diagonal
from softprint.runtime.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Positions of the blocks above the diagonal: row_starts (n+1,), columns (n_blocks,), in CSR order, int32."""

    row_starts: IntArray
    columns: IntArray

    @property
    def n_nodes(self) -> int:
        return len(self.row_starts) - 1

    @cached_property
    def rows(self) -> IntArray:
        """(n_blocks,)"""
        return np.repeat(np.arange(self.n_nodes), np.diff(self.row_starts))

    @classmethod
    def from_pairs(cls, pairs: IntArray, n_nodes: int) -> tuple[BlockPattern, IntArray]:
        """The pattern of node pairs (..., 2), lower node first, repetitions allowed; and the block index (...) of each
        pair."""
        key = pairs[..., 0].astype(np.int64) * n_nodes + pairs[..., 1]
        present, block = np.unique(key, return_inverse=True)
        starts = np.searchsorted(present, np.arange(n_nodes + 1, dtype=np.int64) * n_nodes)
        pattern = cls(starts.astype(np.int32), (present % n_nodes).astype(np.int32))
        return pattern, block.reshape(key.shape)


class UpperBlocks:
    """The blocks above the diagonal on a pattern; read-only.

    storage: (n_blocks + 1, dim, dim) [N/m]; the value of the last block is irrelevant, see `native/blocks.c`.
    """

    def __init__(self, pattern: BlockPattern, storage: Array) -> None:
        self.pattern, self.storage = pattern, storage

    @cached_property
    def single(self) -> Array:
        """The storage in single precision."""
        return self.storage.astype(np.float32)

    def of_type(self, real: Real) -> Array:
        return self.single if real is np.float32 else self.storage


@dataclass(eq=False)
class BlockMatrix:
    """A symmetric matrix over node vectors (n, dim): blocks above the diagonal, those on it (n, dim, dim), plus for
    each entry (w, k) of `low_rank` the rank-dim term k (w w^T) (x) I with w (n,): a spring on the w-weighted mean of
    the nodes."""

    upper: UpperBlocks
    diagonal: Array
    low_rank: tuple[tuple[Array, float], ...] = ()

    @property
    def n_nodes(self) -> int:
        return len(self.diagonal)

    @property
    def dim(self) -> int:
        return int(self.diagonal.shape[1])

    def sparse(self) -> sp.csr_matrix:
        """The block part, both triangles, as a scipy matrix."""
        n, dim = self.n_nodes, self.dim
        pattern, shape = self.upper.pattern, (n * dim, n * dim)
        above = sp.bsr_matrix(
            (self.upper.storage[:-1], pattern.columns, pattern.row_starts), shape=shape
        ).tocsr()
        return above + above.T + block_diagonal(self.diagonal).tocsr()

    def apply(self, v: Array) -> Array:
        """The product with a node vector v (n, dim)."""
        kernels = BlockKernels.of(self.dim, np.float64)
        product = np.empty_like(padded := kernels.vector(v))
        pattern, upper = self.upper.pattern, self.upper.storage
        kernels.product(pattern.row_starts, pattern.columns, self.diagonal, upper, padded, product)
        product = product[:, : self.dim]
        for weights, stiffness in self.low_rank:
            product += stiffness * weights[:, None] * (weights @ v)
        return product

    def diagonal_blocks(self) -> Array:
        """(n, dim, dim), a copy, low-rank terms included."""
        diagonal, identity = self.diagonal.copy(), np.eye(self.dim)
        for weights, stiffness in self.low_rank:
            diagonal += (stiffness * weights**2)[:, None, None] * identity
        return diagonal

    def copy(self) -> BlockMatrix:
        return BlockMatrix(self.upper, self.diagonal.copy(), self.low_rank)

    def add_diagonal(self, index: IntArray, blocks: Array) -> None:
        """Add blocks (m, dim, dim), or scalars (m, 1, 1) times the identity, at the distinct nodes index
        (m,)."""
        if blocks.shape[1] == 1:
            blocks = blocks * np.eye(self.dim)
        self.diagonal[index] += blocks

    def add_low_rank(self, weights: Array, stiffness: float) -> None:
        self.low_rank = (*self.low_rank, (weights, stiffness))
