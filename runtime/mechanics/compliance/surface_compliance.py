"""Surface compliance: the displacement of the body, at rest, by forces on its contact nodes, compressed for real time.

The contact displacement of the truth is an equilibrium in the null space of U (thesis 5.3.3); linearised at rest it is
u = G f (`null_space_compliance.py`). At a deformed state G is carried along by the local rotations R of the body,

    u_X = R_X sum_j G_Xj R_j^T f_j,

which keeps it symmetric (reciprocal) and invariant to rotations of the body.

Forces act on *contact nodes*: the nodes of the surface or, where these are too many, a subset, each representing the
surface area nearest to it. The columns of all contact nodes would be gigabytes for a mesh of the thesis's size. Far
from a contact node its column depends smoothly on the position of the node, so it is interpolated between the columns
of few *anchors*; the interpolation error is stored only near the node:

    G_Xj = sum_a G_Xa P_ja + N_Xj,        N_Xj = 0 unless X is near j.

P starts from moving least squares, which reproduces affine functions, and is then fitted to the column far away: on
the small Jelly this reduces the error of the field of a contact from 3 % to 1 %.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.compliance import surface_compliance_kernels
from softprint.runtime.mechanics.compliance.columns import all_columns, compliance_columns, shared_rows
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance

#: Row starts, columns and entries of a sparse matrix.
CsrParts = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[Any]]

# Anchors. With at most so many contact nodes, each is its own anchor and nothing is interpolated.
_ANCHORS = 400
# Anchors that a contact node is interpolated between.
_NEIGHBOURS = 8
# N is stored within so many mean distances of anchors; with 2 the error doubles.
_NEAR = 3.0
# Far nodes that the shares are fitted to; a fit to all of them is no better.
_FIT_NODES = 600
# Regularisation of the fitted shares towards those of moving least squares, relative to the mean square of the columns.
_RIDGE = 1e-4


@dataclass(frozen=True, eq=False)
class SurfaceCompliance:
    """G of a body with n_contact contact nodes. nodes: (n_contact,) mesh nodes; areas: (n_contact,) [m^(dim-1)];
    anchors: (n_anchors,) which of the contact nodes; operator: (n_anchors, dim, n_nodes, dim) float32 [m/N],
    displacement of every node per unit force on an anchor, in rest coordinates; share: P (n_contact, n_anchors); near:
    N^T (n_contact*dim, n_nodes*dim) float32 [m/N]."""

    nodes: IntArray
    areas: Array
    anchors: IntArray
    operator: NDArray[np.float32]
    share: sp.csr_matrix
    near: sp.csr_matrix

    @property
    def dim(self) -> int:
        return self.operator.shape[1]

    @property
    def n_nodes(self) -> int:
        return self.operator.shape[2]

    def equals(self, other: SurfaceCompliance) -> bool:
        """Whether both are of the same contact nodes, and of a body of the same shape and material."""
        if self is other:
            return True
        return np.array_equal(self.nodes, other.nodes) and np.array_equal(self.operator, other.operator)

    def at(self, nodes: IntArray) -> SurfaceCompliance:
        """The compliance with the same contact nodes and with displacements at some of the nodes."""
        if np.array_equal(nodes, np.arange(self.n_nodes)):
            return self  # all of them: colliders that share the compliance also share its memory
        operator = np.ascontiguousarray(self.operator[:, :, nodes])
        near = self.near[:, _components(nodes, self.dim)]
        return SurfaceCompliance(self.nodes, self.areas, self.anchors, operator, self.share, near)

    def apply(self, index: IntArray, forces: NDArray[Any]) -> NDArray[Any]:
        """sum_j G_Xj forces_j (n_nodes, dim) for forces (m, dim) on some of the contact nodes (m,), in their type."""
        flat = self.operator.reshape(len(self.operator), self.dim, -1)
        total = surface_compliance_kernels.apply(
            index, forces, flat, csr_parts(self.share), csr_parts(self.near)
        )
        return total.reshape(self.n_nodes, self.dim)

    def dense(self) -> NDArray[np.float32]:
        """G^T (n_contact, dim, n_nodes, dim) of all contact nodes: gigabytes for a mesh of the thesis's size."""
        far = self.share.astype(np.float32) @ self.operator.reshape(len(self.operator), -1)
        shape = (len(self.nodes), *self.operator.shape[1:])
        return np.asarray(far.reshape(shape) + self.near.toarray().reshape(shape))

    def among_nodes(self) -> NDArray[np.float32]:
        """[i, j] = G_ij (n_contact, n_contact, dim, dim), symmetrised so that forces derive from an energy.

        Interpolation is not symmetric in contact node and node, nor is the distribution of forces over areas. Cached,
        as several colliders on one body share it.
        """
        return self._among_nodes

    @cached_property
    def _among_nodes(self) -> NDArray[np.float32]:
        pairs = self.at(self.nodes).dense().transpose(0, 2, 1, 3)
        pairs = 0.5 * (pairs + pairs.transpose(1, 0, 3, 2))
        return np.ascontiguousarray(pairs)


def compute_surface_compliance(
    body: ReducedBody,
    response: NullSpaceCompliance,
    at_most: int,
    progress: Callable[[int], None] | None = None,
) -> SurfaceCompliance:
    """G for at most so many contact nodes, chosen by farthest-point sampling where the surface has more nodes.
    progress: called with the number of columns done, of `n_columns` in all."""
    nodes, areas, spread = _contact_nodes(body, at_most)
    rest = body.mesh.points
    if len(nodes) <= _ANCHORS:
        operator = all_columns(response, spread, progress)
        everyone = np.arange(len(nodes))
        nothing = sp.csr_matrix((len(nodes) * body.dim, rest.size), dtype=np.float32)
        return SurfaceCompliance(
            nodes, areas, everyone, operator, sp.identity(len(nodes), format="csr"), nothing
        )
    anchors = np.sort(farthest_points(rest[nodes], _ANCHORS))
    operator = all_columns(response, spread[anchors], progress)
    between, share = _interpolation(rest[nodes], anchors)
    reach = _NEAR * (areas.sum() / len(anchors)) ** (1.0 / (body.dim - 1))
    within = cKDTree(rest).query_ball_point(rest[nodes], reach)
    sample = farthest_points(rest, min(_FIT_NODES, len(rest)))

    def fitted(
        rows: slice, progress: Callable[[int], None]
    ) -> list[tuple[Array, IntArray, NDArray[np.float32]]]:
        """Of every contact node its share of the anchors, and what these do not give at the nodes near it."""
        found, j = [], rows.start
        for columns in compliance_columns(response, spread[rows], progress):
            for column in columns:
                at, along = np.array(within[j]), operator[between[j]]
                far = np.setdiff1d(sample, at)
                own = _fitted(share[j], along[:, :, far], column[:, far])
                missing = column[:, at] - np.tensordot(own.astype(np.float32), along[:, :, at], axes=1)
                found.append((own, at, missing))
                j += 1
        return found

    near = _Rows(rest.shape)
    for block in shared_rows(fitted, len(nodes), body.dim, progress):
        for own, at, missing in block:
            share[near.count] = own
            near.add(at, missing)
    return SurfaceCompliance(nodes, areas, anchors, operator, _shares(between, share, anchors), near.matrix())


def surface_interpolation(rest: Array, anchors: IntArray) -> sp.csr_matrix:
    """Shares (n, n_anchors) of points at rest (n, dim) [m] by moving least squares between some of them."""
    if len(anchors) == len(rest):
        return sp.identity(len(rest), format="csr")
    return _shares(*_interpolation(rest, anchors), anchors)


def _shares(between: IntArray, share: Array, anchors: IntArray) -> sp.csr_matrix:
    """(n, n_anchors) of shares (n, k) of the anchors `between` (n, k)."""
    row = np.repeat(np.arange(len(share)), share.shape[1])
    return sp.csr_matrix((share.ravel(), (row, between.ravel())), shape=(len(share), len(anchors)))


def n_columns(body: ReducedBody, at_most: int) -> int:
    """How many columns `compute_mechanics` solves for: of all contact nodes, and of anchors of the surface and of the
    spread compliance."""
    n_contact = min(len(outside_frames(body)[0]), at_most)
    return 2 * n_contact if n_contact <= _ANCHORS else n_contact + 2 * _ANCHORS


class _Rows:
    """The rows of N^T, contact node by contact node. shape: (n_nodes, dim)."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._size, self._dim = int(np.prod(shape)), shape[1]
        self._indices: list[IntArray] = []
        self._values: list[NDArray[np.float32]] = []

    @property
    def count(self) -> int:
        return len(self._values)

    def add(self, nodes: IntArray, values: NDArray[np.float32]) -> None:
        """Adds the next contact node: values (dim, len(nodes), dim)."""
        order = np.argsort(nodes)
        self._indices.append(np.tile(_components(nodes[order], self._dim), self._dim))
        self._values.append(values[:, order].ravel())

    def matrix(self) -> sp.csr_matrix:
        lengths = np.repeat([len(values) // self._dim for values in self._values], self._dim)
        starts = np.concatenate([[0], np.cumsum(lengths)])
        entries = (np.concatenate(self._values), np.concatenate(self._indices), starts)
        return sp.csr_matrix(entries, shape=(len(lengths), self._size))


def _components(index: IntArray, dim: int) -> IntArray:
    """Rows of the components of points in a matrix over (point, axis)."""
    return np.asarray((np.asarray(index)[:, None] * dim + np.arange(dim)).ravel())


def _interpolation(points: Array, anchors: IntArray) -> tuple[IntArray, Array]:
    """The anchors that each point is interpolated from, and their shares, (n, k) both: moving least squares, exact for
    affine functions along the surface; damped slightly across it, where neighbours may lie in one plane."""
    distance, between = cKDTree(points[anchors]).query(points, k=_NEIGHBOURS)
    reach = 1.05 * distance[:, -1:]
    x = distance / reach
    weight = (1.0 - x**2) ** 2 / (
        x + 1e-3
    ) ** 3  # nearly singular at an anchor, for exact interpolation there
    offset = (points[anchors][between] - points[:, None]) / reach[..., None]
    terms = np.concatenate([np.ones((*x.shape, 1)), offset], axis=2)
    moment = np.einsum("nk,nki,nkj->nij", weight, terms, terms)
    damping = 1e-3 * np.diag(np.append(0.0, np.ones(points.shape[1])))
    moment += damping * weight.sum(axis=1)[:, None, None]
    constant = np.append(1.0, np.zeros(points.shape[1]))
    along = np.linalg.solve(moment, np.broadcast_to(constant[:, None], (*moment.shape[:2], 1)))
    share: Array = weight * (terms @ along)[..., 0]
    return between, share


def _fitted(share: Array, columns: NDArray[np.float32], column: NDArray[np.float32]) -> Array:
    """Shares (k,) of `columns` (k, ...) that fit `column` in the least-squares sense, regularised towards `share`."""
    flat = columns.reshape(len(columns), -1).astype(np.float64)
    gram = flat @ flat.T
    residual = flat @ (column.ravel() - share @ flat)
    ridge = _RIDGE * np.trace(gram) / len(gram)
    return np.asarray(share + np.linalg.solve(gram + ridge * np.eye(len(gram)), residual))


def csr_parts(matrix: sp.csr_matrix) -> CsrParts:
    """Row starts, columns and entries."""
    return matrix.indptr, matrix.indices, matrix.data


def outside_frames(body: ReducedBody) -> tuple[IntArray, Array]:
    """Nodes of the surface outside rigid frames, and their areas."""
    mesh = body.mesh
    outside = ~np.isin(mesh.surface_nodes, body.handles.frame_nodes)
    if not outside.any():
        raise SoftprintError(
            f"body {body.name!r}: all of its surface lies in rigid frames, so no contact node can be displaced"
        )
    return mesh.surface_nodes[outside], mesh.surface_areas[outside]


def _contact_nodes(body: ReducedBody, at_most: int) -> tuple[IntArray, Array, sp.csr_matrix]:
    """The contact nodes, their areas, and the distribution of their forces over the nodes: (n_contact, n_nodes), with
    rows that sum to one."""
    candidates, areas = outside_frames(body)
    rest, nodes = body.mesh.points, candidates
    if len(candidates) > at_most:
        nodes = candidates[np.sort(farthest_points(rest[candidates], at_most))]
    _, nearest = cKDTree(rest[nodes]).query(rest[candidates])
    total = np.bincount(nearest, areas, minlength=len(nodes)).astype(np.float64)
    spread = sp.csr_matrix((areas / total[nearest], (nearest, candidates)), shape=(len(nodes), len(rest)))
    return nodes, total, spread
