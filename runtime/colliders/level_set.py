"""The surface of any collider as line segments or triangles: the zero level of its signed distance."""

from __future__ import annotations

import igl
import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh.mesh import facet_vectors

CELLS = {2: 240, 3: 72}  # of the grid along the longest side


def collider_surface(collider: Collider, cells: int | None = None) -> tuple[Array, IntArray]:
    """Vertices (v, dim) [m] in the collider's coordinates and facets (f, dim), normals outward.

    Found on a grid of ``cells`` along the longest side of the collider. Raises SoftprintError for a collider without
    bounds (a plane).
    """
    extent = collider.upper - collider.lower
    if not np.isfinite(extent).all():
        raise SoftprintError(f"collider {collider.name!r} has no bounds, so its surface cannot be meshed")
    spacing = float(extent.max()) / (cells or CELLS[collider.dim])
    lower = collider.lower - 1.5 * spacing
    counts = np.ceil(extent / spacing).astype(int) + 4
    axes = [low + spacing * np.arange(count) for low, count in zip(lower, counts)]
    # The first coordinate varies fastest, as marching cubes requires.
    points = np.stack(np.meshgrid(*axes[::-1], indexing="ij")[::-1], axis=-1).reshape(-1, collider.dim)
    values = collider.sdf(points)
    if collider.dim == 3:
        vertices, facets, _ = igl.marching_cubes(values, points, *(int(count) for count in counts), 0.0)
    else:
        vertices, facets = _marching_triangles(values, points, int(counts[0]))
    if len(facets) == 0:
        raise SoftprintError(
            f"collider {collider.name!r} is thinner than {spacing:.3g} m: its surface cannot be found"
        )
    return _facing_outward(collider, np.asarray(vertices), np.asarray(facets, dtype=np.int64))


def placed_surface(collider: Collider, pose: RigidPose) -> tuple[Array, IntArray] | None:
    """Vertices in the world and facets of a collider at its pose; None for a plane, which is unbounded."""
    if not np.isfinite(collider.upper - collider.lower).all():
        return None
    vertices, facets = collider_surface(collider)
    return pose.apply(vertices), facets


def _marching_triangles(values: Array, points: Array, width: int) -> tuple[Array, IntArray]:
    """Where linear interpolation on the grid's half squares crosses zero; grid points row by row."""
    corner = np.flatnonzero(np.arange(len(points)) % width != width - 1)
    corner = corner[corner < len(points) - width]
    halves = np.concatenate(
        [corner[:, None] + np.array(order) for order in ((0, 1, width + 1), (0, width + 1, width))]
    )
    inside = values[halves] < 0
    count = inside.sum(axis=1)
    crossed = halves[(count == 1) | (count == 2)]
    inside = values[crossed] < 0
    # First the corner that is alone on its side, then the other two.
    alone = np.argmax(inside == (inside.sum(axis=1) == 1)[:, None], axis=1)
    rows = np.arange(len(crossed))
    ends = np.stack(
        [np.sort(crossed[[rows, rows], [alone, (alone + k) % 3]].T, axis=1) for k in (1, 2)], axis=1
    )
    edges, segment = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    below, above = values[edges[:, 0]], values[edges[:, 1]]
    share = (below / (below - above))[:, None]
    vertices = (1.0 - share) * points[edges[:, 0]] + share * points[edges[:, 1]]
    return vertices, segment.reshape(-1, 2).astype(np.int64)


def _facing_outward(collider: Collider, vertices: Array, facets: IntArray) -> tuple[Array, IntArray]:
    """Facets without the degenerate ones, flipped where their normal points down the distance's gradient."""
    normals = facet_vectors(vertices, facets)
    kept = (normals * normals).sum(axis=1) > 0
    facets, normals = facets[kept], normals[kept]
    slope = collider.sdf_derivatives(vertices[facets].mean(axis=1)).gradient
    inward = (slope * normals).sum(axis=1) < 0
    facets = facets.copy()
    facets[inward, :2] = facets[inward, 1::-1]
    return vertices, facets
