"""Tetrahedra for a solid that is given by a field, negative inside: the way from a formula, or from the distance to a
skin, to a body. Needs gmsh.

The zero level is found by marching cubes, remeshed by gmsh with triangles of one size, drawn back onto the level, and
filled with tetrahedra that grow towards the inside.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import gmsh
import numpy as np
from field_grid import Grid
from scipy.sparse import coo_matrix

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.mesh import Mesh, in_morton_order, oriented_mesh, write_mesh
from softprint.runtime.shapes.solid import Field

Size = Callable[[Array], float]  # the edge length [m] that is wanted at a point (3,)

GROWTH = 0.5  # of edge lengths, for each metre of depth
SMOOTHINGS = 12  # rounds of smoothing along the surface after its remeshing


def mesh_solid(field: Field, lower: Array, upper: Array, size: Size, inside: Size, spacing: float) -> Mesh:
    """A body of these edge lengths at the surface, growing with depth up to ``inside``. The box holds the solid and
    some room around it; spacing: of the grid that the field is taken on [m]."""
    grid = Grid(field, lower, upper, spacing)
    surface, triangles = remeshed(*grid.zero_level(), size)
    surface = smoothed(surface, triangles, grid)
    points, cells = filled(
        surface, triangles, lambda p: min(inside(p), size(p) + GROWTH * max(0.0, -grid.nearest(p)))
    )
    return in_morton_order(oriented_mesh(points, cells, "the solid"))


def mesh_from_command_line(
    line: str, field: Field, lower: Array, upper: Array, spacing: float, share: Size = lambda _: 1.0
) -> None:
    """What a script of a solid does: reads edge lengths and a file name, and writes the mesh. line: about the script;
    share: of the edge length at the surface that is wanted at a point; otherwise see `mesh_solid`."""
    parser = argparse.ArgumentParser(description=line)
    parser.add_argument("--edge-length", type=float, required=True, help="edge length at the surface [m]")
    parser.add_argument("--inside", type=float, required=True, help="edge length in the middle [m]")
    parser.add_argument("--out", type=Path, required=True, help="mesh file to write (.vtu, .msh, ...)")
    given = parser.parse_args()
    mesh = mesh_solid(
        field, lower, upper, lambda p: given.edge_length * share(p), lambda _: float(given.inside), spacing
    )
    write_mesh(given.out, mesh)
    print(f"{given.out}: {mesh.n_nodes} nodes, {mesh.n_cells} tetrahedra")


def smooth_maximum(a: Array, b: Array, width: float) -> Array:
    """max(a, b), rounded where the two come closer than the width."""
    return np.maximum(a, b) + 0.25 * np.maximum(width - np.abs(a - b), 0.0) ** 2 / width


def remeshed(vertices: Array, triangles: IntArray, size: Size) -> tuple[Array, IntArray]:
    """A closed surface meshed anew."""
    gmsh.initialize()
    try:
        _quiet()
        _discrete_surface(vertices, triangles)
        gmsh.model.mesh.classifySurfaces(
            np.pi, True, True, np.pi
        )  # no edge is sharp: all is one smooth surface
        gmsh.model.mesh.createGeometry()
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, there: size(np.array([x, y, z])))
        gmsh.model.mesh.generate(2)
        return _mesh_of(2)
    finally:
        gmsh.finalize()


def smoothed(vertices: Array, triangles: IntArray, grid: Grid) -> Array:
    """Vertices evened out: each goes half the way to the mean of its neighbours, and back onto the level."""
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    both = np.vstack([edges, edges[:, ::-1]])
    adjacent = coo_matrix((np.ones(len(both)), both.T), shape=(len(vertices),) * 2).tocsr()
    count = np.asarray(adjacent.sum(axis=1))
    for _ in range(SMOOTHINGS):
        vertices = grid.on_level(vertices + 0.5 * (adjacent @ vertices / count - vertices))
    return vertices


def filled(vertices: Array, triangles: IntArray, size: Size) -> tuple[Array, IntArray]:
    """Points and tetrahedra inside a closed surface, whose triangles stay as they are."""
    gmsh.initialize()
    try:
        _quiet()
        surface = _discrete_surface(vertices, triangles)
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop([surface])])
        gmsh.model.geo.synchronize()
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, there: size(np.array([x, y, z])))
        gmsh.option.setNumber("Mesh.OptimizeNetgen", 1)
        gmsh.model.mesh.generate(3)
        return _mesh_of(3)
    finally:
        gmsh.finalize()


def _quiet() -> None:
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)


def _discrete_surface(vertices: Array, triangles: IntArray) -> int:
    surface = int(gmsh.model.addDiscreteEntity(2))
    gmsh.model.mesh.addNodes(2, surface, np.arange(1, len(vertices) + 1), vertices.ravel())
    gmsh.model.mesh.addElementsByType(surface, 2, [], triangles.ravel() + 1)
    return surface


def _mesh_of(dim: int) -> tuple[Array, IntArray]:
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(4 if dim == 3 else 2)
    used, cells = np.unique(nodes.astype(np.int64), return_inverse=True)
    place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    place[tags.astype(np.int64)] = np.arange(len(tags))
    return coordinates.reshape(-1, 3)[place[used]], cells.reshape(-1, dim + 1)
