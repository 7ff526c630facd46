"""Null-space compliance: the linear response of the body in the null space of the reduced coordinates.

The displacement u with C^T u = 0 (no change of the reduced state, see `ReducedBody.constraint_basis`) that balances
nodal forces f is (thesis 5.3.3, linearised at rest)

    u = G f,    G = A - A Q (Q^T A Q)^-1 Q^T A,    A = K^-1,

with K the elastic stiffness of the nodes outside rigid frames and Q an orthonormal basis of the columns of C there.
G is symmetric, C^T G = 0, and it depends on the body alone, unless another K than that at rest is given.

Without frames K is singular for rigid motions, which only the constraint prevents. So that K can be factorised, springs
of stiffness D support as many components E of nodes as there are rigid motions, and their forces are taken out again
together with those of the constraint (Woodbury identity), which is exact for any D, even for K of several materials:

    G = A - A B (B^T A B - S)^-1 B^T A,    A = (K + E D E^T)^-1,    B = [Q E],    S = diag(0, D^-1).

Every solve is checked: what the constraint does not bear, P (f - K u) with P = 1 - Q Q^T, is below a tolerance of P f.

K is factorised in a nested-dissection order by coordinates: on solids it gives a quarter less fill than minimum degree
and, above all, wide supernodes, so that factorisation and solves are three to four times as fast.
"""

from __future__ import annotations

from copy import copy
from itertools import combinations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import qr
from scipy.sparse.linalg import splu

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

# Largest residual of a solve, relative to its forces: the round-off of the single precision that results are stored in.
_TOLERANCE = 1e-7
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
        self._name = body.name
        kept = body.constraint_basis[self._free]
        left, singular, _ = np.linalg.svd(kept, full_matrices=False)
        self._constraint = np.kron(left[:, singular > 1e-10 * singular.max(initial=0.0)], np.eye(body.dim))
        floating = not body.handles.frames
        self._supported = supports(body.mesh.points[self._free]) if floating else np.empty(0, dtype=np.int64)
        self._factorise(stiffness)

    def with_stiffness(self, stiffness: sp.csr_matrix) -> NullSpaceCompliance:
        """G of another K (n_nodes dim, n_nodes dim) [N/m], such as that of a deformed body."""
        other = copy(self)
        other._factorise(stiffness)
        return other

    def _factorise(self, stiffness: sp.csr_matrix) -> None:
        self._stiffness = stiffness[self._unknowns][:, self._unknowns]
        n, at = len(self._unknowns), self._supported
        springs = self._stiffness.diagonal()[at]
        self._factor = splu(
            (self._stiffness + sp.csr_matrix((springs, (at, at)), shape=(n, n))).tocsc(),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        support = np.zeros((n, len(at)))
        support[at, np.arange(len(at))] = 1.0
        self._held = np.hstack([self._constraint, support])
        # For a body of rigid frames alone no columns are left, which SuperLU does not accept.
        self._deflected = self._factor.solve(self._held) if self._held.size else self._held
        of_springs = np.append(np.zeros(self._constraint.shape[1]), 1.0 / springs)
        self._multipliers = self._held.T @ self._deflected - np.diag(of_springs)

    def solve(self, forces: Array) -> Array:
        """u = G f (n_nodes, dim, k) [m] for k sets of nodal forces (n_nodes, dim, k) [N]. Raises SoftprintError where
        round-off leaves a larger error than the tolerance."""
        n_sets = forces.shape[2]
        # G Q = 0: what the constraint bears is taken out first, and the rest solved to its own size, however small.
        among = self._projected(np.ascontiguousarray(forces[self._free]).reshape(-1, n_sets))
        response = self._constrained(among)
        residual, error = self._residual(among, response)
        # Where materials are up to 10^4 times as stiff as others, this meets the tolerance; up to 10^6, one refinement
        # does. A second would not help: what is left by the first is the round-off of K u.
        if error > _TOLERANCE:
            response += self._constrained(residual)
            residual, error = self._residual(among, response)
        if not error <= _TOLERANCE:
            raise SoftprintError(
                f"body {self._name!r}: displacements by forces are wrong by {error:.0e} of the forces, more than "
                f"{_TOLERANCE:.0e}: its materials differ too much in stiffness (make the stiffest part a rigid frame), "
                "or cells are nearly flat"
            )
        displacement = np.zeros((*self.shape, n_sets))
        displacement[self._free] = response.reshape(len(self._free), -1, n_sets)
        return displacement

    def _constrained(self, forces: Array) -> Array:
        """A f - A B (B^T A B - S)^-1 B^T A f (n_unknowns, k) [m] of forces f (n_unknowns, k) [N]."""
        response: Array = self._factor.solve(forces)
        response -= self._deflected @ np.linalg.solve(self._multipliers, self._held.T @ response)
        return response

    def _residual(self, forces: Array, response: Array) -> tuple[Array, float]:
        """P (f - K u) (n_unknowns, k) [N] for f = P f, and the largest of |P (f - K u)| / |f| and |Q^T u| / |u|."""
        residual: Array = self._stiffness @ response
        np.subtract(forces, residual, out=residual)
        residual = self._projected(residual)
        error = max(_ratio(residual, forces), _ratio(self._constraint.T @ response, response))
        return residual, error

    def _projected(self, forces: Array) -> Array:
        """P f (n_unknowns, k) [N], the part of the forces that the constraint does not bear, in place."""
        forces -= self._constraint @ (self._constraint.T @ forces)
        return forces


def _ratio(part: Array, whole: Array) -> float:
    """The largest |part| / |whole| of columns (n, k) and (m, k), 0 where they are zero."""
    squares, of = np.einsum("nk,nk->k", part, part), np.einsum("nk,nk->k", whole, whole)
    return float(np.sqrt(np.max(squares / np.where(of > 0.0, of, 1.0), initial=0.0)))


def supports(points: Array) -> IntArray:
    """Components (dim (dim + 1) / 2,), of all (n dim,) of points (n, dim), at which a body is supported against every
    rigid motion. A QR decomposition with pivoting chooses those where the rigid motions differ most."""
    axes, offset = np.eye(points.shape[1]), points - points.mean(axis=0)
    offset /= np.abs(offset).max()
    shifts = [np.broadcast_to(axis, points.shape) for axis in axes]
    turns = [
        offset[:, [i]] * axes[j] - offset[:, [j]] * axes[i] for i, j in combinations(range(len(axes)), 2)
    ]
    motions = np.reshape([*shifts, *turns], (len(shifts) + len(turns), -1))
    _, order = qr(motions, mode="r", pivoting=True)
    return np.asarray(order[: len(motions)])


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
