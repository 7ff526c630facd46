"""A closed surface from triangles that do not close, overlap or are a soup, by generalised winding numbers.

The winding number w of a point (Jacobson et al. 2013) is one inside of a closed surface and zero outside, and changes
smoothly where the surface has holes. With the unsigned distance d to the triangles, the zero level of

    s = d (1 - 2 w)

is the surface where there is one, and spans the holes where w = 1/2.
"""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from runtime.arrays import Array, BoolArray, IntArray
from runtime.errors import SoftprintError

# Cells of the grid along the longest side: as fine as a collider's own grid is by default, and a third.
CELLS = 64
# If the winding number of more of the inside than this is nearer to 1/2 than to 1, there is no telling what is inside.
MOST_DOUBT = 0.3
# How far before and behind a facet it is looked whether that is outside and inside, as a share of the diagonal.
_BESIDE = 1e-5


class Rebuilt(NamedTuple):
    """vertices (v, 3), triangles (t, 3): closed, facing outward; spacing: of the grid; doubt: share of the inside whose
    winding number is below 3/4."""

    vertices: Array
    triangles: IntArray
    spacing: float
    doubt: float


def misplaced(vertices: Array, triangles: IntArray) -> BoolArray:
    """(t,) which facets have not the outside before them (w = 0) and the inside behind them (w = 1).

    None of a closed surface that faces outward and nowhere passes through itself; overlaps bury some.
    """
    vertices = _scaled(vertices)[0]
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    middle = corners.mean(axis=1)
    beside = np.vstack([middle + _BESIDE * normal, middle - _BESIDE * normal])
    before, behind = np.asarray(igl.fast_winding_number(vertices, triangles, beside)).reshape(2, -1)
    return np.asarray((np.abs(before) > 0.5) | (np.abs(behind - 1.0) > 0.5))


def rebuilt_surface(vertices: Array, triangles: IntArray, source: str, cells: int = CELLS) -> Rebuilt:
    """The surface around what the triangles enclose; `source` names the mesh in messages.

    Raises SoftprintError where they enclose nothing for certain.
    """
    vertices, origin, unit = _scaled(vertices)
    extent = vertices.max(axis=0)
    spacing = float(extent.max()) / cells
    nodes = np.ceil(extent / spacing).astype(int) + 5
    axes = [spacing * (np.arange(n) - 2.0 + 0.137) for n in nodes]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])  # x runs fastest, as marching cubes wants it
    winding = np.asarray(igl.fast_winding_number(vertices, triangles, points))
    if winding[np.argmax(np.abs(winding))] < 0:  # the whole of it faces inward
        winding = -winding
    inside = winding > 0.5
    doubt = float((inside & (winding < 0.75)).sum() / max(inside.sum(), 1))
    if not inside.any() or doubt > MOST_DOUBT:
        raise SoftprintError(
            f"{source}: encloses nothing for certain: by its winding numbers it is not clear what is inside; "
            "close the surface in a modeller and let all of it face outward"
        )
    sides = inside.reshape(nodes[::-1])
    crossed = (
        maximum_filter(sides, 3) != minimum_filter(sides, 3)
    ).ravel()  # the others only need their sign
    distance = np.full(len(points), spacing)
    distance[crossed] = np.sqrt(igl.point_mesh_squared_distance(points[crossed], vertices, triangles)[0])
    signed = distance * (1.0 - 2.0 * winding)
    border = signed.reshape(nodes[::-1])
    for axis in range(3):  # nothing can be inside out there
        for end in (0, -1):
            side = np.moveaxis(border, axis, 0)
            side[end] = np.maximum(side[end], spacing)
    signed = border.ravel()
    near = np.abs(signed) < 0.02 * spacing  # nodes off the surface, so that triangles keep some area
    signed[near] = np.where(signed[near] < 0, -0.02, 0.02) * spacing
    surface, facets, _ = igl.marching_cubes(signed, points, *(int(n) for n in nodes), 0.0)
    surface, facets = _outward(surface, facets)
    return Rebuilt(origin + unit * surface, facets, unit * spacing, doubt)


def _scaled(vertices: Array) -> tuple[Array, Array, float]:
    """Vertices from the origin on with a diagonal of one, where they began, and their unit: libigl takes winding
    numbers in single precision."""
    origin, unit = vertices.min(axis=0), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    return (vertices - origin) / unit, origin, unit


def _outward(vertices: Array, triangles: IntArray) -> tuple[Array, IntArray]:
    volume = np.linalg.det(vertices[triangles]).sum()
    return vertices, triangles[:, ::-1].copy() if volume < 0 else triangles


def deviation(vertices: Array, triangles: IntArray, surface: tuple[Array, IntArray]) -> Array:
    """(t,) distance [as given] of the middles of triangles from another surface."""
    squared = igl.point_mesh_squared_distance(vertices[triangles].mean(axis=1), *surface)[0]
    return np.sqrt(np.asarray(squared))
