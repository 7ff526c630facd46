"""From raw points and cells to a valid mesh: orientation is repaired, every other defect is refused."""

from __future__ import annotations

import logging

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh.mesh import FACETS, Mesh, signed_volumes

log = logging.getLogger(__name__)

# A cell is degenerate below this share of (its longest edge)^dim: round-off of float32 coordinates is about
# 1e-7.
DEGENERATE = 1e-6


@np.errstate(over="ignore", invalid="ignore")  # absurd coordinates are refused below
def oriented_mesh(points: Array, cells: IntArray, source: str = "the mesh") -> Mesh:
    """A checked :class:`Mesh`: unused nodes dropped, inverted cells reoriented (both logged).

    points: (n, dim) [m], cells: (m, dim+1). Raises SoftprintError, naming ``source``, for: no cells,
    indices out of range, coordinates that are not finite, degenerate or repeated cells, facets shared by
    more than two cells or by two cells on the same side, and a mesh in several pieces (pieces that touch
    only in a node or an edge count as several).
    """
    points = np.array(points, dtype=np.float64)
    cells = np.array(cells, dtype=np.int64)
    if (
        points.ndim != 2
        or points.shape[1] not in (2, 3)
        or cells.ndim != 2
        or cells.shape[1] != points.shape[1] + 1
    ):
        raise SoftprintError(
            f"{source}: points {points.shape} and cells {cells.shape} are neither triangles in 2D nor "
            f"tetrahedra in 3D"
        )
    if len(cells) == 0:
        raise SoftprintError(f"{source}: has no cells; a body needs triangles (2D) or tetrahedra (3D)")
    if cells.min() < 0 or cells.max() >= len(points):
        raise SoftprintError(
            f"{source}: a cell names node {cells.max()}, but there are only {len(points)} nodes"
        )
    points, cells = _drop_unused(points, cells, source)
    if not np.isfinite(points).all():
        node = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise SoftprintError(f"{source}: node {node} has coordinates that are not finite: {points[node]}")
    cells = _orient(points, cells, source)
    _check_facets(cells, points.shape[1], source)
    return Mesh(points, cells)


def _drop_unused(points: Array, cells: IntArray, source: str) -> tuple[Array, IntArray]:
    used, renumbered = np.unique(cells, return_inverse=True)
    if len(used) < len(points):
        log.info("%s: dropped %d nodes that belong to no cell", source, len(points) - len(used))
    return points[used], renumbered.reshape(cells.shape).astype(np.int64)


def _orient(points: Array, cells: IntArray, source: str) -> IntArray:
    volumes = signed_volumes(points, cells)
    corners = points[cells]
    longest = np.sqrt(((corners[:, :, None] - corners[:, None]) ** 2).sum(axis=-1).max(axis=(1, 2)))
    flat = np.abs(volumes) <= DEGENERATE * longest ** points.shape[1]
    if flat.any():
        cell = int(np.flatnonzero(flat)[0])
        raise SoftprintError(
            f"{source}: {flat.sum()} of {len(cells)} cells have no volume (the first is cell {cell}, at "
            f"{np.round(corners[cell].mean(axis=0), 6).tolist()}): mesh the body again with better-shaped "
            f"cells"
        )
    inverted = volumes < 0
    if inverted.any():
        log.info("%s: reoriented %d inverted cells of %d", source, inverted.sum(), len(cells))
        cells = cells.copy()
        cells[inverted, -2:] = cells[inverted, -1:-3:-1]
    return cells


def _check_facets(cells: IntArray, dim: int, source: str) -> None:
    if len(np.unique(np.sort(cells, axis=1), axis=0)) < len(cells):
        raise SoftprintError(f"{source}: some cells occur twice: remove the repeated cells")
    every = cells[:, FACETS[dim]].reshape(-1, dim)
    order = np.argsort(every, axis=1)
    _, facet, count = np.unique(
        np.take_along_axis(every, order, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    facet = facet.reshape(-1)
    if (count > 2).any():
        raise SoftprintError(
            f"{source}: not a manifold: {(count > 2).sum()} facets are shared by more than two cells "
            "(overlapping or repeated parts): mesh the body again"
        )
    # Two neighbours have opposite orientations of their common facet; equal orientations mean that one lies in the
    # other.
    even = np.linalg.det(np.eye(dim)[order]) > 0
    balance = np.bincount(facet, weights=np.where(even, 1.0, -1.0))
    if (np.abs(balance[count == 2]) > 0).any():
        raise SoftprintError(
            f"{source}: not a manifold: neighbouring cells overlap (the mesh is folded): mesh the body again"
        )
    pieces = int(facet_pieces(cells).max()) + 1
    if pieces > 1:
        raise SoftprintError(
            f"{source}: is in {pieces} pieces that share no facet; a body must be one piece: keep one, or "
            f"join them"
        )


def facet_pieces(cells: IntArray) -> IntArray:
    """(n_cells,) the number of the piece that a cell (n_cells, dim+1) belongs to: cells that share a facet are one."""
    dim = cells.shape[1] - 1
    every = np.sort(cells[:, FACETS[dim]].reshape(-1, dim), axis=1)
    _, facet = np.unique(every, axis=0, return_inverse=True)
    owner = np.repeat(np.arange(len(cells)), dim + 1)
    touches = sp.csr_matrix((np.ones(len(owner)), (owner, facet.reshape(-1))))
    return np.asarray(connected_components(touches @ touches.T, directed=False)[1], dtype=np.int64)
