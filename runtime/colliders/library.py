"""Library shapes in metres: their triangles by marching cubes, and their colliders."""

from __future__ import annotations

from functools import lru_cache

import igl
import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.colliders.surface_mesh.mesh_collider import surface_collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.shapes import Shape, find_shape

# Nodes this close to the surface, in cells, are moved off it, so that no triangle degenerates and no vertices coincide.
CLEARANCE = 0.02


def library_surface(name: str, size: float = 1.0) -> tuple[Array, IntArray]:
    """Vertices (v, 3) [m] and triangles (t, 3) of a shape about the origin whose largest extent is twice `size`.

    Closed, facing outward, and free of self-intersections, since marching cubes stays within its cells.
    """
    unit, triangles, _centre, _half = _unit_surface(find_shape(name))
    return size * unit, triangles.copy()


def library_collider(entry: str, size: float, resolution: int = 48, name: str | None = None) -> GridCollider:
    """The smooth signed distance of a shape; resolution: grid cells along its longest side.

    Sampled from the shape's own signed distance if it has one, and from the distance to its triangles otherwise.
    Raises SoftprintError if there is no such shape.
    """
    shape = find_shape(entry)
    vertices, triangles = library_surface(entry, size)
    called = name or entry
    if not shape.exact:
        return surface_collider(vertices, triangles, resolution, called)
    _, _, centre, half = _unit_surface(shape)
    scale = size / half
    return GridCollider(
        lambda z: scale * shape.field(z / scale + centre), vertices, triangles, resolution, called
    )


@lru_cache(maxsize=4)
def _unit_surface(shape: Shape) -> tuple[Array, IntArray, Array, float]:
    """Vertices scaled into [-1, 1]^3, triangles, and the centre and half of the largest extent before scaling."""
    vertices, triangles = zero_level(shape)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    centre, half = 0.5 * (lower + upper), 0.5 * float((upper - lower).max())
    return (vertices - centre) / half, triangles, centre, half


def zero_level(shape: Shape, cells: int | None = None) -> tuple[Array, IntArray]:
    """The surface of a shape in its own units; cells: of the grid, the shape's own number by default."""
    reach = np.array(shape.reach, dtype=float)
    spacing = 2 * reach.max() / (cells or shape.cells)
    nodes = 2 * np.ceil(reach / spacing).astype(int) + 6
    # Shifted off the planes of symmetry, where many fields are zero on whole faces of the grid.
    origin = -0.5 * (nodes - 1) * spacing + spacing * np.array([0.137, 0.291, 0.213])
    axes = [o + spacing * np.arange(n) for o, n in zip(origin, nodes, strict=True)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])  # x varies fastest
    values = shape.field(points)
    border = values.reshape(nodes[::-1])
    if min(np.take(border, (0, -1), axis=axis).min() for axis in range(3)) <= 0:
        raise SoftprintError(f"library shape '{shape.name}' reaches beyond the box given by its reach")
    near = np.abs(values) < CLEARANCE * spacing
    values[near] = np.where(values[near] < 0, -CLEARANCE, CLEARANCE) * spacing
    vertices, triangles, _ = igl.marching_cubes(values, points, *(int(n) for n in nodes), 0.0)
    corners = vertices[triangles]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return vertices, triangles[:, ::-1].copy() if volume < 0 else triangles
