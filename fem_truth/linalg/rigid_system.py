"""The rows of a projected linear system that belong to regions which move rigidly, see `rigid_regions.py`."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from softprint.fem_truth.linalg.block_kernels import Real
from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.fem_truth.linalg.rigid_regions import RigidTangent
from softprint.fem_truth.linalg.small_blocks import absolute_inverses, block_diagonal
from softprint.runtime.arrays import Array, IntArray


class RigidSystem:
    """The rows of T^T H T + K in a projected linear system, and the preconditioner of these: their inverse, without
    what facets and eliminated unknowns add."""

    def __init__(self, tangent: RigidTangent, hessian: BlockMatrix, real: Real) -> None:
        self._at = RigidTangent(tangent.nodes, tangent.modes.astype(real), tangent.stiffness.astype(real))
        self._dim = hessian.dim
        own = tangent.modes.T @ (_between(hessian, tangent.nodes) @ tangent.modes)
        matrix = own.toarray() + tangent.stiffness
        for weights, stiffness in hessian.low_rank:
            pulled = tangent.modes.T @ np.kron(weights[tangent.nodes, None], np.eye(hessian.dim))
            matrix += stiffness * pulled @ pulled.T
        self._inverse = absolute_inverses(matrix[None])[0].astype(real)

    def add_stiffness(self, p: Array, y: Array) -> float:
        """y += T K T^T p; returns p . T K T^T p."""
        coordinates = self._at.coordinates(p)
        force = self._at.stiffness @ coordinates
        y[self._at.nodes, : self._dim] += self._at.displacement(force)
        return float(coordinates @ force)

    def coordinates(self, v: Array) -> Array:
        """T^T v (m,)."""
        return self._at.coordinates(v)

    def spread(self, coordinates: Array, v: Array) -> None:
        """Writes T a into v (n, dim or more), of coordinates a (m,)."""
        v[self._at.nodes, : self._dim] = self._at.displacement(coordinates)

    def preconditioned(self, coordinates: Array) -> Array:
        return np.asarray(self._inverse @ coordinates)


def _between(hessian: BlockMatrix, nodes: IntArray) -> sp.csr_matrix:
    """The blocks between these nodes (k*dim, k*dim), of cells alone."""
    pattern, dim, count = hessian.upper.pattern, hessian.dim, len(nodes)
    place = np.full(hessian.n_nodes, -1)
    place[nodes] = np.arange(count)
    rows, columns = place[pattern.rows], place[pattern.columns]
    both = np.flatnonzero((rows >= 0) & (columns >= 0))
    axis = np.arange(dim)
    i = rows[both, None, None] * dim + axis[:, None] + 0 * axis
    j = columns[both, None, None] * dim + axis + 0 * axis[:, None]
    above = sp.csr_matrix(
        (hessian.upper.storage[both].ravel(), (i.ravel(), j.ravel())), shape=(count * dim, count * dim)
    )
    return sp.csr_matrix(above + above.T + block_diagonal(hessian.diagonal[nodes]))
