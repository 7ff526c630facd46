"""How deep the surface of a collider lies inside a deformed body: found without the contact law, to check it.

Points on the collider's surface are located in the deformed cells of the body; the depth of a point inside is its
distance from the deformed surface. A contact law that looks at points of the body alone, however small the penetration
that it reports, can let a thin part of the collider through between these points: then this depth is large.
"""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.contact.piercing_kernels import bounds, in_box
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.mesh.simplex_kernels import bounding_balls

# Round-off of barycentric coordinates: a point on the face between two cells is inside one of them.
_ON_A_FACE = -1e-9


def pierced_from(mesh: Mesh) -> float:
    """The depth [m] from which on a collider has pierced the surface: the distance between surface nodes. Contact at
    nodes resolves nothing finer, so less is the error of a mesh, and more a part of the collider on the wrong side."""
    return mesh.surface_spacing


class Intrusion(NamedTuple):
    """depth: of the deepest point of a collider inside a body [m], 0 if none is; point: (dim,) where it is."""

    depth: float
    point: Array


def intrusion(points: Array, mesh: Mesh, positions: Array) -> Intrusion:
    """Of points (m, dim) [m] of a collider's surface, in the world, in the body with this rest mesh and its nodes at
    positions (n_nodes, dim) [m]. NaN without points: of a collider without bounds."""
    if not len(points):
        return Intrusion(np.nan, np.full(mesh.dim, np.nan))
    inside = points[located(points, mesh, positions)]
    if not len(inside):
        return Intrusion(0.0, np.full(mesh.dim, np.nan))
    depth = _surface_distance(inside, mesh, positions)
    deepest = int(np.argmax(depth))
    return Intrusion(float(depth[deepest]), inside[deepest])


def located(points: Array, mesh: Mesh, positions: Array) -> BoolArray:
    """(m,) which of the points (m, dim) are inside the deformed surface. A point in as many inverted cells as others is
    where the body has folded over and its surface does not enclose it: there the winding number, which is the number of
    cells over it with their orientation, is zero."""
    turns = np.zeros(len(points))
    about = in_box(points, *bounds(positions))
    if not len(about):
        return turns != 0.0
    centre, radius = bounding_balls(positions, mesh.cells)
    reach = float(radius.max())
    lower, upper = bounds(points[about])
    cells = in_box(centre, lower - reach, upper + reach)
    near = cKDTree(points[about]).query_ball_point(centre[cells], radius[cells])
    counts = np.array([len(some) for some in near], dtype=np.int64)
    corners = positions[mesh.cells[cells[counts > 0]]]
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    volume = np.linalg.det(edges)
    flat = volume == 0.0
    inverse = np.linalg.inv(np.where(flat[:, None, None], np.eye(mesh.dim), edges))
    inverse[flat] = np.nan  # no point is in a flat cell
    cell = np.repeat(np.arange(len(corners)), counts[counts > 0])
    point = about[np.concatenate([*near, []]).astype(np.int64)]
    share = np.einsum("kij,kj->ki", inverse[cell], points[point] - corners[cell, 0])
    within = (share >= _ON_A_FACE).all(axis=1) & (share.sum(axis=1) <= 1.0 - _ON_A_FACE)
    np.add.at(turns, point[within], np.sign(volume[cell[within]]))
    return turns != 0.0


def _surface_distance(points: Array, mesh: Mesh, positions: Array) -> Array:
    """(m,) [m] distance of points (m, dim) from the deformed surface."""
    centre, radius = bounding_balls(positions, mesh.facets)
    # No facet farther than this is the nearest of a point.
    farthest = float(cKDTree(centre).query(points)[0].max()) + float(radius.max())
    lower, upper = bounds(points)
    facets = mesh.facets[in_box(centre, lower - farthest, upper + farthest)]
    in_space = [np.pad(each, ((0, 0), (0, 3 - mesh.dim))) for each in (points, positions)]
    squared, _, _ = igl.point_mesh_squared_distance(*in_space, facets.astype(np.int64))
    return np.asarray(np.sqrt(squared))
