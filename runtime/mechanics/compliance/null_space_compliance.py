"""Null-space compliance: the linear response of the body in the null space of the reduced coordinates.

The displacement u with C^T u = 0 (no change of the reduced state, see `ReducedBody.constraint_basis`) that balances
nodal forces f is (thesis 5.3.3, linearised at rest)

    u = G f,    G = A - A Q (Q^T A Q)^-1 Q^T A,    A = K^-1,

with K the elastic stiffness of the nodes outside rigid frames and Q an orthonormal basis of the columns of C there.
G is symmetric, C^T G = 0, and it depends on the body alone, unless another K than that at rest is given.

K is factorised in a nested-dissection order by coordinates: on solids it gives a quarter less fill than minimum degree
and, above all, wide supernodes, so that factorisation and solves are three to four times as fast.
"""

from __future__ import annotations

from copy import copy

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.mesh import Mesh

# A diagonal shift, relative to the mean diagonal of K, that keeps K invertible for a body without rigid frames. The
# constraint then removes rigid motions, and iterative refinement the effect of the shift on the rest. With a smaller
# shift, round-off in the rigid motions dominates the solution.
_SHIFT = 1e-5
_REFINEMENTS = 2
# Nodes of a part that is not divided further; larger or smaller by a factor of two makes no difference.
_LEAF = 60


class NullSpaceCompliance:
    """G of a body, factorised. shape: (n_nodes, dim)."""

    def __init__(self, body: ReducedBody) -> None:
        self.shape = body.mesh.points.shape
        free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
        stiffness = rest_stiffness(body)
        adjacent = node_adjacency(body.mesh)[free][:, free]
        self._free = free[dissection_order(body.mesh.points[free], adjacent)]
        self._unknowns = (self._free[:, None] * body.dim + np.arange(body.dim)).ravel()
        self._floating = not body.handles.frames
        kept = body.constraint_basis[self._free]
        left, singular, _ = np.linalg.svd(kept, full_matrices=False)
        self._constraint = np.kron(left[:, singular > 1e-10 * singular.max(initial=0.0)], np.eye(body.dim))
        self._factorise(stiffness)

    def with_stiffness(self, stiffness: sp.csr_matrix) -> NullSpaceCompliance:
        """G of another K (n_nodes dim, n_nodes dim) [N/m], such as that of a deformed body."""
        other = copy(self)
        other._factorise(stiffness)
        return other

    def _factorise(self, stiffness: sp.csr_matrix) -> None:
        self._stiffness = stiffness[self._unknowns][:, self._unknowns]
        shift = _SHIFT * self._stiffness.diagonal().mean() if self._floating else 0.0
        self._factor = splu(
            (self._stiffness + shift * sp.identity(len(self._unknowns))).tocsc(),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        # For a body of rigid frames alone no columns are left, which SuperLU does not accept.
        size = self._constraint.size
        self._deflected = self._factor.solve(self._constraint) if size else self._constraint
        self._lagrange = np.linalg.inv(self._constraint.T @ self._deflected)

    def solve(self, forces: Array) -> Array:
        """u = G f (n_nodes, dim, k) [m] for k sets of nodal forces (n_nodes, dim, k) [N]."""
        n_sets = forces.shape[2]
        among = np.ascontiguousarray(forces[self._free]).reshape(-1, n_sets)
        response = self._constrained(among)
        for _ in range(_REFINEMENTS if self._floating else 0):
            response += self._constrained(among - self._stiffness @ response)
        displacement = np.zeros((*self.shape, n_sets))
        displacement[self._free] = response.reshape(len(self._free), -1, n_sets)
        return displacement

    def _constrained(self, forces: Array) -> Array:
        """The constrained response (n_unknowns, k) to forces (n_unknowns, k), with the shifted factors."""
        response: Array = self._factor.solve(forces)
        response -= self._deflected @ (self._lagrange @ (self._constraint.T @ response))
        return response


def rest_stiffness(body: ReducedBody, among: IntArray | slice = slice(None)) -> sp.csr_matrix:
    """(n_nodes dim, n_nodes dim) K = d2W_elastic/dx2 at rest [N/m], of all cells or of some."""
    return elastic_stiffness(body.mesh, body.material, among)


def elastic_stiffness(
    mesh: Mesh, material: Material, among: IntArray | slice = slice(None), x: Array | None = None
) -> sp.csr_matrix:
    """(n_nodes dim, n_nodes dim) d2W_elastic/dx2 [N/m] of a mesh and its material, of all cells or of some, at
    positions x (n_nodes, dim), by default at rest."""
    dim = mesh.dim
    corners, gradients, volumes = mesh.cells[among], mesh.cell_gradients[among], mesh.cell_volumes[among]
    F = np.broadcast_to(np.eye(dim), (len(corners), dim, dim)).copy()
    if x is not None:
        F = np.einsum("cai,caj->cij", x[corners], gradients)
    tangent = material.at(among).tangent(F)
    cells = np.einsum("c,caj,cijkl,cbl->caibk", volumes, gradients, tangent, gradients, optimize=True)
    size = (dim + 1) * dim
    dofs = (corners[:, :, None] * dim + np.arange(dim)).reshape(-1, size)
    entries = (np.repeat(dofs, size, axis=1).ravel(), np.tile(dofs, (1, size)).ravel())
    shape = (mesh.n_nodes * dim, mesh.n_nodes * dim)
    return sp.coo_matrix((cells.ravel(), entries), shape=shape).tocsr()


def dissection_order(points: Array, adjacent: sp.csr_matrix) -> IntArray:
    """Nested dissection of n points (n, dim) with an adjacency (n, n): halves along the axis whose separator is
    smallest, first one half, then the other, then the separator."""
    n, dim = points.shape
    side = np.zeros(n, dtype=bool)

    def parts(index: IntArray) -> list[IntArray]:
        if len(index) <= _LEAF:
            return [index]
        neighbours = adjacent[index]
        cuts = []
        for axis in range(dim):
            along = points[index, axis]
            low = along < np.median(along)
            side[index] = low
            cuts.append((low, ~low & (neighbours @ side.astype(np.float32) > 0)))
            side[index] = False
        low, separator = min(cuts, key=lambda cut: int(cut[1].sum()))
        rest = ~low & ~separator
        if not low.any() or not rest.any():
            return [index]
        return [*parts(index[low]), *parts(index[rest]), index[separator]]

    return np.concatenate(parts(np.arange(n)))


def node_adjacency(mesh: Mesh) -> sp.csr_matrix:
    """(n_nodes, n_nodes) nodes that share a cell."""
    cells, corners = mesh.cells, mesh.dim + 1
    row, column = np.repeat(cells, corners, axis=1).ravel(), np.tile(cells, (1, corners)).ravel()
    ones = np.ones(len(row), dtype=np.float32)
    return sp.csr_matrix((ones, (row, column)), shape=(mesh.n_nodes, mesh.n_nodes))
