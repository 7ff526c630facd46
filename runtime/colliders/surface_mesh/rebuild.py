"""A closed surface from open, overlapping or unconnected triangles, by generalised winding numbers.

The winding number w of a point (Jacobson et al. 2013) is one inside a closed surface and zero outside, and varies
smoothly across holes of the surface. With the unsigned distance d to the triangles, the zero level of

    s = d (1 - 2 w)

is the surface where there is one, and spans holes where w = 1/2.
"""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.errors import SoftprintError

# Cells of the grid along the longest side: a third more than a collider's grid has by default.
CELLS = 64
# If more than this share of the inside has a winding number nearer to 1/2 than to 1, the inside is not well defined.
MOST_DOUBT = 0.3
# Distance from a facet, as a share of the diagonal, at which the winding number is evaluated on both of its sides.
_OFFSET = 1e-5


class Rebuilt(NamedTuple):
    """vertices (v, 3), triangles (t, 3): closed, facing outward; spacing: of the grid; doubt: share of the inside with
    a winding number below 3/4."""

    vertices: Array
    triangles: IntArray
    spacing: float
    doubt: float


def misplaced(vertices: Array, triangles: IntArray) -> BoolArray:
    """(t,) which facets do not have the outside in front (w = 0) and the inside behind (w = 1).

    For a closed, outward-facing surface without self-intersections there are none; overlaps bury some facets.
    """
    vertices = _scaled(vertices)[0]
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    middle = corners.mean(axis=1)
    both_sides = np.vstack([middle + _OFFSET * normal, middle - _OFFSET * normal])
    before, behind = np.asarray(igl.fast_winding_number(vertices, triangles, both_sides)).reshape(2, -1)
    return np.asarray((np.abs(before) > 0.5) | (np.abs(behind - 1.0) > 0.5))


def rebuilt_surface(vertices: Array, triangles: IntArray, source: str, cells: int = CELLS) -> Rebuilt:
    """The surface around what the triangles enclose; `source` names the mesh in messages.

    Raises SoftprintError if the enclosed volume is not well defined.
    """
    vertices, origin, unit = _scaled(vertices)
    extent = vertices.max(axis=0)
    spacing = float(extent.max()) / cells
    nodes = np.ceil(extent / spacing).astype(int) + 5
    axes = [spacing * (np.arange(n) - 2.0 + 0.137) for n in nodes]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])  # x fastest, for marching cubes
    winding = np.asarray(igl.fast_winding_number(vertices, triangles, points))
    if winding[np.argmax(np.abs(winding))] < 0:  # the whole surface faces inward
        winding = -winding
    inside = winding > 0.5
    doubt = float((inside & (winding < 0.75)).sum() / max(inside.sum(), 1))
    if not inside.any() or doubt > MOST_DOUBT:
        raise SoftprintError(
            f"{source}: does not enclose a well-defined volume (by winding numbers, inside and outside are ambiguous); "
            "close the surface in a modeller and orient all of it outward"
        )
    sides = inside.reshape(nodes[::-1])
    crossed = (
        maximum_filter(sides, 3) != minimum_filter(sides, 3)
    ).ravel()  # of the others only the sign is needed
    distance = np.full(len(points), spacing)
    distance[crossed] = np.sqrt(igl.point_mesh_squared_distance(points[crossed], vertices, triangles)[0])
    signed = distance * (1.0 - 2.0 * winding)
    surface, facets = closed_level(signed.reshape(nodes[::-1]), points, spacing)
    return Rebuilt(origin + unit * surface, facets, unit * spacing, doubt)


def closed_level(signed: Array, points: Array, spacing: float) -> tuple[Array, IntArray]:
    """The zero level of a field as a closed surface that faces outward, by marching cubes. signed: (n_z, n_y, n_x)
    values at the nodes of a grid, negative inside, whose border is outside; points: (n, 3) of the nodes, x
    fastest."""
    signed = signed.copy()
    for axis in range(3):
        for end in (0, -1):
            side = np.moveaxis(signed, axis, 0)
            side[end] = np.maximum(side[end], spacing)
    nodes, values = signed.shape[::-1], signed.ravel()
    near = np.abs(values) < 0.02 * spacing  # moved off the surface, so that no triangle degenerates
    values[near] = np.where(values[near] < 0, -0.02, 0.02) * spacing
    surface, facets, _ = igl.marching_cubes(values, points, *(int(n) for n in nodes), 0.0)
    return _outward(surface, facets)


def _scaled(vertices: Array) -> tuple[Array, Array, float]:
    """Vertices shifted to the origin and scaled to a diagonal of one, their shift and their scale: libigl computes
    winding numbers in single precision."""
    origin, unit = vertices.min(axis=0), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    return (vertices - origin) / unit, origin, unit


def _outward(vertices: Array, triangles: IntArray) -> tuple[Array, IntArray]:
    volume = np.linalg.det(vertices[triangles]).sum()
    return vertices, triangles[:, ::-1].copy() if volume < 0 else triangles


def deviation(vertices: Array, triangles: IntArray, surface: tuple[Array, IntArray]) -> Array:
    """(t,) distance of the triangles' centroids from another surface, in their unit."""
    squared = igl.point_mesh_squared_distance(vertices[triangles].mean(axis=1), *surface)[0]
    return np.sqrt(np.asarray(squared))
