"""The null space of U^T, for columns U of the reduced basis: displacements that do not change the reduced state
(thesis 5.3.3).

    P = I - U_f (U_f^T U_f)^-1 U_f^T   on the free nodes f, the same for each coordinate;  P = 0 on the fixed
    nodes.

U has one column per handle row, so P acts on the (n_nodes, dim) array directly: the Kronecker form P (x) I.

Regions of fixed nodes may move rigidly instead (`rigid_regions.py`). With an orthonormal basis T of what their twists
do, the coordinates of v are those of its free nodes and T^T v, and U^T v = 0 couples both.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from softprint.fem_truth.linalg.block_kernels import BlockKernels, Real, fitting_tile
from softprint.fem_truth.linalg.rigid_regions import RigidTangent
from softprint.fem_truth.parts.share import WHOLE, Share
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.errors import SoftprintError

# Beyond this condition number of U_f, the Gram matrix loses all digits and the constraint cannot be satisfied to
# 1e-10.
MAX_CONDITION = 1e7


class KernelBasis(NamedTuple):
    """A range of nodes in the layout of the kernels: rows of a node vector; Q in tiles; mask of free entries (n,
    width)."""

    rows: slice
    Q: Array
    moving: Array


class NullSpace:
    """Projector onto {v: v_fixed = 0, U^T v = 0} for node vectors v (n_nodes, dim).

    basis: U (n_nodes, n_rows), possibly with no columns; fixed: indices of fixed nodes; share: this rank's share of the
    nodes, if the body is partitioned over ranks. Raises SoftprintError if the columns of U are linearly dependent on
    the free nodes.
    """

    def __init__(self, basis: Array, fixed: IntArray, share: Share = WHOLE) -> None:
        self.share = share
        self.free = np.ones(len(basis), dtype=bool)
        self.free[fixed] = False
        self._mask = self.free[:, None].astype(float)
        self._columns = basis
        self.rigid: RigidTangent | None = None
        reduced = basis * self._mask
        n_free = int(share.total(float(self.free[share.owned].sum())))
        self.condition = _condition(reduced, n_free, share)
        self._basis = np.ascontiguousarray(orthonormal(reduced, share))
        self._coupling, self._gram = np.zeros((0, 0)), np.zeros((0, 0))
        self._for_kernels: dict[tuple[int, Real], tuple[BlockKernels, tuple[KernelBasis, ...]]] = {}

    def with_rigid(self, rigid: RigidTangent) -> NullSpace:
        """The same where these nodes, which are fixed here, move rigidly; for a body that is whole on this rank."""
        moving = copy(self)
        moving.rigid = rigid
        if self.rank:
            at_regions = self._columns[rigid.nodes] @ self._to_basis
            dim = rigid.modes.shape[0] // len(rigid.nodes)
            moving._coupling = np.asarray(rigid.modes.T @ np.kron(at_regions, np.eye(dim)))
            moving._gram = np.linalg.inv(np.eye(self.rank * dim) + moving._coupling.T @ moving._coupling)
        return moving

    @cached_property
    def _to_basis(self) -> Array:
        """R with Q = U_f R."""
        return np.linalg.lstsq(self._columns * self._mask, self._basis, rcond=None)[0]

    def coupled(self, by_nodes: Array, by_twists: Array) -> Array:
        """Coordinates c (rank, dim) of the part of v that violates U^T v = 0, from Q^T v (rank, dim) of its free nodes
        and T^T v (m,): it is Q c at the free nodes, and `by_twists_of(c)` in the twists."""
        if not self.rank:
            return by_nodes
        whole = by_nodes.ravel() + by_twists @ self._coupling
        return np.asarray(self._gram @ whole).reshape(by_nodes.shape)

    def by_twists_of(self, c: Array) -> Array:
        """B c (m,), see `coupled`."""
        assert self.rigid is not None
        return self._coupling @ c.ravel() if self.rank else np.zeros(self.rigid.modes.shape[1])

    @property
    def rank(self) -> int:
        """Number of constraints per coordinate."""
        return int(self._basis.shape[1])

    @property
    def orthonormal_basis(self) -> Array:
        """Q (n_nodes, rank) with Q^T Q = I and the range of U_f; zero rows at fixed nodes."""
        return self._basis

    def project(self, v: Array) -> Array:
        """P v, (n_nodes, dim)."""
        rigid, free = self.rigid, v * self._mask
        c = self._coordinates(free)
        if rigid is None:
            return free - self._basis @ c
        twists = rigid.coordinates(v)
        c = self.coupled(c, twists)
        free -= self._basis @ c
        free[rigid.nodes] = rigid.displacement(twists - self.by_twists_of(c))
        return free

    def moving(self, dim: int) -> Array:
        """(n_nodes, dim): 1 for free components, 0 for fixed ones."""
        return np.repeat(self._mask, dim, axis=1)

    def projected_norm(self, nodes: IntArray, v: Array) -> float:
        """|P v| of a vector that is v (m, dim) at the distinct nodes (m,) that this rank owns and zero elsewhere: its
        norm without the component in the range of Q."""
        v = v * self._mask[nodes]
        within = self.share.total(self._basis[nodes].T @ v)
        square = self.share.total(float(np.vdot(v, v)))
        return float(np.sqrt(max(square - float(np.vdot(within, within)), 0.0)))

    def for_kernels(self, dim: int, real: Real) -> tuple[BlockKernels, tuple[KernelBasis, ...]]:
        """Kernels for node vectors of this null space, and their data for each range of nodes; cached."""
        if (dim, real) not in self._for_kernels:
            kernels = BlockKernels.of(dim, real, fitting_tile(self.rank))
            self._for_kernels[dim, real] = (
                kernels,
                tuple(
                    KernelBasis(run, kernels.tiled(self._basis[run]), kernels.vector(self.moving(dim)[run]))
                    for run in self.share.runs
                ),
            )
        return self._for_kernels[dim, real]

    def violation(self, v: Array) -> float:
        """Largest entry of Q^T v and of v at fixed nodes, in the unit of v: zero on the null space."""
        fixed = self.share.largest(float(np.abs(v[~self.free]).max(initial=0.0)))
        return float(max(fixed, np.abs(self._coordinates(v)).max(initial=0.0)))

    def _coordinates(self, v: Array) -> Array:
        """Q^T v, (rank, dim), of the free nodes."""
        owned = self.share.owned
        return self.share.total(self._basis[owned].T @ v[owned])


def orthonormal(columns: Array, share: Share) -> Array:
    """Orthonormal Q with the range of the columns (n, k) or (n, dim, k), by Cholesky QR of the small Gram matrix, done
    twice to remove round-off."""
    count = columns.shape[-1]
    for _ in range(2 if count else 0):
        own = columns[share.owned].reshape(-1, count)
        lower = cholesky(share.total(own.T @ own), lower=True)
        columns = solve_triangular(lower, columns.reshape(-1, count).T, lower=True).T.reshape(columns.shape)
    return columns


def _condition(basis: Array, n_free: int, share: Share) -> float:
    """Condition number of U_f with columns scaled to length one; raises SoftprintError for dependent columns."""
    if basis.shape[1] == 0:
        return 1.0
    own = basis[share.owned]
    lengths = np.sqrt(share.total((own**2).sum(axis=0)))
    if (lengths == 0).any() or n_free < basis.shape[1]:
        raise SoftprintError(
            f"the subspace leaves no free unknowns: {basis.shape[1]} handle rows on {n_free} free nodes, columns "
            f"{np.flatnonzero(lengths == 0).tolist()} of U vanish there; use fewer handles "
            "or smaller frame regions"
        )
    # The R factor of the stacked R factors of all ranks is that of all rows; it has the singular values of U_f.
    values = np.linalg.svd(share.stacked(np.asarray(np.linalg.qr(own / lengths, mode="r"))), compute_uv=False)
    condition = float(values[0] / values[-1]) if values[-1] > 0 else np.inf
    if condition > MAX_CONDITION:
        raise SoftprintError(
            f"the columns of the subspace basis are linearly dependent on the {n_free} free nodes (condition "
            f"number {condition:.1e}, at most {MAX_CONDITION:.0e}): two handles move the same nodes in the "
            "same way; move them apart or remove one"
        )
    return condition
