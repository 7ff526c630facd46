"""How the body gives way, at rest, where the subspace cannot: the operator that every correction of ours rests on.

A displacement that the reduced state does not feel, C^T u = 0 (see `ReducedBody.constraint_basis`), balances forces f
on the nodes when (thesis 5.3.3, linearised at rest)

    u = G f,    G = A - A Q (Q^T A Q)^-1 Q^T A,    A = K^-1,

K being the elastic stiffness of the nodes outside rigid frames and Q an orthonormal basis of the columns of C there.
G is symmetric, C^T G = 0, and it belongs to the body alone.

K is factorised in an order of nested dissection by coordinates: on solids it leaves a quarter less fill than minimum
degree and, above all, wide supernodes, so that factorisation and solves are three to four times as fast.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody

# Keeps K invertible for a body without rigid frames, relative to its mean diagonal; rigid motions are then taken
# out by the constraint, and what the shift does to the rest by so many steps of iterative refinement. Smaller, and
# the rigid motions drown the answer in round-off.
_SHIFT = 1e-5
_REFINEMENTS = 2
# Nodes that are no longer halved; larger or smaller by a factor of two makes no difference.
_LEAF = 60


class NullSpaceCompliance:
    """G of a body, factorised. shape: (n_nodes, dim)."""

    def __init__(self, body: ReducedBody) -> None:
        self.shape = body.mesh.points.shape
        free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
        stiffness = rest_stiffness(body)
        adjacent = _adjacency(body)[free][:, free]
        self._free = free[dissection_order(body.mesh.points[free], adjacent)]
        unknowns = (self._free[:, None] * body.dim + np.arange(body.dim)).ravel()
        self._stiffness = stiffness[unknowns][:, unknowns]
        self._floating = not body.handles.frames
        shift = _SHIFT * self._stiffness.diagonal().mean() if self._floating else 0.0
        self._factor = splu(
            (self._stiffness + shift * sp.identity(len(unknowns))).tocsc(),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        kept = body.constraint_basis[self._free]
        left, singular, _ = np.linalg.svd(kept, full_matrices=False)
        self._constraint = np.kron(left[:, singular > 1e-10 * singular.max(initial=0.0)], np.eye(body.dim))
        # A body of frames alone has no columns left, which SuperLU would not solve for.
        self._deflected = self._factor.solve(self._constraint) if kept.size else self._constraint
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
        """Of forces (n_unknowns, k), with the factors at hand."""
        response: Array = self._factor.solve(forces)
        response -= self._deflected @ (self._lagrange @ (self._constraint.T @ response))
        return response


def rest_stiffness(body: ReducedBody, among: IntArray | slice = slice(None)) -> sp.csr_matrix:
    """(n_nodes dim, n_nodes dim) K = d2W_elastic/dx2 at rest [N/m], of all cells or some of them."""
    mesh, dim = body.mesh, body.dim
    corners, gradients, volumes = mesh.cells[among], mesh.cell_gradients[among], mesh.cell_volumes[among]
    rest = np.broadcast_to(np.eye(dim), (len(corners), dim, dim)).copy()
    tangent = body.material.at(among).tangent(rest)
    cells = np.einsum("c,caj,cijkl,cbl->caibk", volumes, gradients, tangent, gradients, optimize=True)
    size = (dim + 1) * dim
    dofs = (corners[:, :, None] * dim + np.arange(dim)).reshape(-1, size)
    entries = (np.repeat(dofs, size, axis=1).ravel(), np.tile(dofs, (1, size)).ravel())
    shape = (mesh.n_nodes * dim, mesh.n_nodes * dim)
    return sp.coo_matrix((cells.ravel(), entries), shape=shape).tocsr()


def dissection_order(points: Array, adjacent: sp.csr_matrix) -> IntArray:
    """Nested dissection of n points (n, dim) with an adjacency (n, n): halves along the axis whose separator is
    smallest, first one half, then the other, then the points that part them."""
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


def _adjacency(body: ReducedBody) -> sp.csr_matrix:
    """(n_nodes, n_nodes) nodes that share a cell."""
    cells, corners = body.mesh.cells, body.dim + 1
    row, column = np.repeat(cells, corners, axis=1).ravel(), np.tile(cells, (1, corners)).ravel()
    ones = np.ones(len(row), dtype=np.float32)
    return sp.csr_matrix((ones, (row, column)), shape=(body.n_nodes, body.n_nodes))
