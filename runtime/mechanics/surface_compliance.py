"""How the body gives way, at rest, to forces on its surface that the subspace cannot feel, ready for real time.

The contact displacement of the truth is an equilibrium in the null space of U (thesis 5.3.3); linearised at rest it is
u = G f (`null_space_compliance.py`). At a deformed state G is carried along by the local deformation F,

    u_X = F_X sum_j G_Xj F_j^T f_j,

which keeps it symmetric (forces do the work that displacements receive) and turns with the body.

Forces act on *loads*: the nodes of the surface, or, where these are too many, points among them that each stand for
the area nearest to it. The columns of all loads would be gigabytes for a mesh of thesis size. But far from a load its
column is smooth in where the load sits, so that it is interpolated between those of few *anchors*; only near the load
is the rest kept:

    G_Xj = sum_a G_Xa P_ja + N_Xj,        N_Xj = 0 unless X is near j.

P starts from moving least squares, which reproduces affine functions, and is then fitted to the column far away: on
the small Jelly that leaves 1 % of the field of a contact instead of 3 %.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.body.farthest_points import farthest_points
from runtime.errors import SoftprintError
from runtime.mechanics import surface_compliance_kernels
from runtime.mechanics.null_space_compliance import NullSpaceCompliance

# Columns solved at a time, to bound memory.
_COLUMNS = 240
# Anchors; fewer loads than this are their own anchors, and nothing is interpolated.
_ANCHORS = 400
# Anchors that a load is interpolated between.
_NEIGHBOURS = 8
# Kept in full within so many mean distances of anchors; with 2 the error doubles.
_NEAR = 3.0
# A sample of the far nodes is enough to fit shares to; all of them change nothing.
_FIT_NODES = 600
# Pull of the fitted shares towards those of moving least squares, relative to the mean square of the columns.
_RIDGE = 1e-4


@dataclass(frozen=True, eq=False)
class SurfaceCompliance:
    """G of a body. nodes: (n_loads,) load nodes; areas: (n_loads,) [m^(dim-1)]; anchors: (n_anchors,) which of the
    loads; operator: (n_anchors, dim, n_nodes, dim) float32 [m/N], displacement of every node per unit force on an
    anchor, in rest coordinates; share: P (n_loads, n_anchors); near: N^T (n_loads*dim, n_nodes*dim) float32 [m/N]."""

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

    def at(self, nodes: IntArray) -> SurfaceCompliance:
        """The same loads, felt at some of the nodes."""
        if np.array_equal(nodes, np.arange(self.n_nodes)):
            return self  # all of them: colliders that share the compliance share its memory too
        operator = np.ascontiguousarray(self.operator[:, :, nodes])
        near = self.near[:, _components(nodes, self.dim)]
        return SurfaceCompliance(self.nodes, self.areas, self.anchors, operator, self.share, near)

    def apply(self, loads: IntArray, forces: NDArray[Any]) -> NDArray[Any]:
        """sum_j G_Xj forces_j (n_nodes, dim) for forces (m, dim) on the loads (m,), in their type."""
        flat = self.operator.reshape(len(self.operator), self.dim, -1)
        total = surface_compliance_kernels.apply(loads, forces, flat, _parts(self.share), _parts(self.near))
        return total.reshape(self.n_nodes, self.dim)

    def dense(self) -> NDArray[np.float32]:
        """G^T (n_loads, dim, n_nodes, dim) of all loads: gigabytes at thesis size."""
        far = self.share.astype(np.float32) @ self.operator.reshape(len(self.operator), -1)
        shape = (len(self.nodes), *self.operator.shape[1:])
        return np.asarray(far.reshape(shape) + self.near.toarray().reshape(shape))

    def among_loads(self) -> NDArray[np.float32]:
        """[i, j] = G_ij (n_loads, n_loads, dim, dim), made symmetric: only then do forces derive from an energy.

        Interpolation is not symmetric in load and node, nor is the spreading of forces over areas. Kept, for several
        colliders on one body share it.
        """
        return self._among_loads

    @cached_property
    def _among_loads(self) -> NDArray[np.float32]:
        pairs = self.at(self.nodes).dense().transpose(0, 2, 1, 3)
        pairs = 0.5 * (pairs + pairs.transpose(1, 0, 3, 2))
        return np.ascontiguousarray(pairs)


def compute_surface_compliance(
    body: ReducedBody,
    response: NullSpaceCompliance,
    at_most: int,
    progress: Callable[[int], None] | None = None,
) -> SurfaceCompliance:
    """G for at most so many loads, chosen by farthest point where the surface has more nodes. progress: called with
    the number of columns done, of `n_columns` in all."""
    nodes, areas, spread = _loads(body, at_most)
    rest = body.mesh.points
    if len(nodes) <= _ANCHORS:
        operator = np.concatenate(list(_columns(response, spread, progress)))
        everyone = np.arange(len(nodes))
        nothing = sp.csr_matrix((len(nodes) * body.dim, rest.size), dtype=np.float32)
        return SurfaceCompliance(
            nodes, areas, everyone, operator, sp.identity(len(nodes), format="csr"), nothing
        )
    anchors = np.sort(farthest_points(rest[nodes], _ANCHORS))
    operator = np.concatenate(list(_columns(response, spread[anchors], progress)))
    between, share = _interpolation(rest[nodes], anchors)
    reach = _NEAR * (areas.sum() / len(anchors)) ** (1.0 / (body.dim - 1))
    within = cKDTree(rest).query_ball_point(rest[nodes], reach)
    sample = farthest_points(rest, min(_FIT_NODES, len(rest)))
    near = _Rows(rest.shape)
    for columns in _columns(response, spread, progress):
        for column in columns:
            load = near.count
            at, along = np.array(within[load]), operator[between[load]]
            far = np.setdiff1d(sample, at)
            share[load] = _fitted(share[load], along[:, :, far], column[:, far])
            near.add(
                at, column[:, at] - np.tensordot(share[load].astype(np.float32), along[:, :, at], axes=1)
            )
    interpolation = sp.csr_matrix(
        (share.ravel(), (np.repeat(np.arange(len(nodes)), share.shape[1]), between.ravel())),
        shape=(len(nodes), len(anchors)),
    )
    return SurfaceCompliance(nodes, areas, anchors, operator, interpolation, near.matrix())


def n_columns(body: ReducedBody, at_most: int) -> int:
    """How many columns `compute_surface_compliance` solves for, anchors counted twice."""
    n_loads = min(len(_candidates(body)[0]), at_most)
    return n_loads if n_loads <= _ANCHORS else n_loads + _ANCHORS


def _columns(
    response: NullSpaceCompliance, spread: sp.csr_matrix, progress: Callable[[int], None] | None
) -> Iterator[NDArray[np.float32]]:
    """Columns (k, dim, n_nodes, dim) of loads with forces spread (n, n_nodes), some at a time."""
    n_nodes, dim = response.shape
    step = max(1, _COLUMNS // dim)
    for start in range(0, spread.shape[0], step):
        weights = spread[start : start + step].toarray()
        forces = np.einsum("kn,ab->nakb", weights, np.eye(dim)).reshape(n_nodes, dim, -1)
        moved = response.solve(forces).reshape(n_nodes, dim, len(weights), dim)
        yield np.ascontiguousarray(moved.transpose(2, 3, 0, 1), dtype=np.float32)
        if progress is not None:
            progress(len(weights))


class _Rows:
    """The rows of N^T, load by load. shape: (n_nodes, dim)."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._size, self._dim = int(np.prod(shape)), shape[1]
        self._indices: list[IntArray] = []
        self._values: list[NDArray[np.float32]] = []

    @property
    def count(self) -> int:
        return len(self._values)

    def add(self, nodes: IntArray, values: NDArray[np.float32]) -> None:
        """The next load: values (dim, len(nodes), dim)."""
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
    """Which anchors each point lies between, and their shares, (n, k) both: moving least squares, exact for affine
    functions along the surface; across it, where neighbours may lie in one plane, gently damped."""
    distance, between = cKDTree(points[anchors]).query(points, k=_NEIGHBOURS)
    reach = 1.05 * distance[:, -1:]
    x = distance / reach
    weight = (1.0 - x**2) ** 2 / (x + 1e-3) ** 3  # singular at an anchor, which is then met exactly
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
    """Shares (k,) of `columns` (k, ...) that come nearest to `column` in the least-squares sense, near those given."""
    flat = columns.reshape(len(columns), -1).astype(np.float64)
    gram = flat @ flat.T
    missed = flat @ (column.ravel() - share @ flat)
    ridge = _RIDGE * np.trace(gram) / len(gram)
    return np.asarray(share + np.linalg.solve(gram + ridge * np.eye(len(gram)), missed))


def _parts(matrix: sp.csr_matrix) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[Any]]:
    """Row starts, columns and entries."""
    return matrix.indptr, matrix.indices, matrix.data


def _candidates(body: ReducedBody) -> tuple[IntArray, Array]:
    """Nodes of the surface outside rigid frames, and their areas."""
    mesh = body.mesh
    outside = ~np.isin(mesh.surface_nodes, body.handles.frame_nodes)
    if not outside.any():
        raise SoftprintError(
            f"body {body.name!r}: all of its surface lies in rigid frames, where nothing gives way"
        )
    return mesh.surface_nodes[outside], mesh.surface_areas[outside]


def _loads(body: ReducedBody, at_most: int) -> tuple[IntArray, Array, sp.csr_matrix]:
    """Load nodes, their areas, and how each spreads its force: (n_loads, n_nodes), rows that sum to one."""
    candidates, areas = _candidates(body)
    rest, nodes = body.mesh.points, candidates
    if len(candidates) > at_most:
        nodes = candidates[np.sort(farthest_points(rest[candidates], at_most))]
    _, nearest = cKDTree(rest[nodes]).query(rest[candidates])
    total = np.bincount(nearest, areas, minlength=len(nodes)).astype(np.float64)
    spread = sp.csr_matrix((areas / total[nearest], (nearest, candidates)), shape=(len(nodes), len(rest)))
    return nodes, total, spread
