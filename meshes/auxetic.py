"""A bar of re-entrant cells, which widens as it is stretched (thesis, figure 4.8). Needs gmsh.

    python meshes/auxetic.py --out meshes/auxetic.vtu
    python meshes/auxetic.py --small --out meshes/auxetic_small.vtu

Each cell is a hexagon whose top and bottom point inwards: upright walls of length h, slanted walls of length l at the
angle theta, all of thickness t (Gibson and Ashby, Cellular Solids, 1997, figure 4.17; theta is negative there). Columns
of cells follow each other along x, between two solid blocks by which the bar is held.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import gmsh
import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.mesh import Mesh, in_morton_order, oriented_mesh, write_mesh


@dataclass(frozen=True)
class Cells:
    """columns of `rows` cells; slanted: l [m]; upright: h [m]; angle: theta [rad], negative; wall: t [m]."""

    columns: int
    rows: int
    slanted: float = 0.010
    upright: float = 0.020
    angle: float = -np.pi / 6
    wall: float = 0.0014

    @property
    def half_width(self) -> float:
        """Half the distance between columns of upright walls of a cell [m]."""
        return float(self.slanted * np.cos(self.angle))

    @property
    def pitch(self) -> float:
        """From a row of upright walls to the next [m]."""
        return float(self.upright + self.slanted * np.sin(self.angle))

    def hexagon(self, offset: float) -> Array:
        """(6, 2) corners of the cell about the origin, moved outwards by `offset` [m]; negative: inwards."""
        a, half, tip = self.half_width, 0.5 * self.upright, self.pitch - 0.5 * self.upright
        corners = np.array([[a, -half], [a, half], [0.0, tip], [-a, half], [-a, -half], [0.0, -tip]])
        return _offset(corners, offset)

    def centres(self) -> Array:
        """(n, 2) middles of the cells [m]: every other column is half a cell higher, and has one row less."""
        found = []
        for column in range(self.columns):
            lower = column % 2
            for row in range(self.rows - lower):
                height = (row - 0.5 * (self.rows - 1 - lower)) * 2.0 * self.pitch
                found.append(((1 + column) * self.half_width, height))
        return np.array(found)


FULL, SMALL = Cells(columns=11, rows=3), Cells(columns=5, rows=2, wall=0.002)
BLOCK = 0.008  # length of the solid blocks at both ends [m]


def mesh_auxetic(cells: Cells, edge_length: float) -> Mesh:
    """The bar, from x = -BLOCK and with y = 0 in its middle."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        solid = [_polygon(cells.hexagon(0.5 * cells.wall) + centre) for centre in cells.centres()]
        length, top = (1 + cells.columns) * cells.half_width, cells.pitch * (cells.rows - 1)
        top += 0.5 * cells.upright + cells.wall
        for low, high in ((-BLOCK, 0.5 * cells.wall), (length - 0.5 * cells.wall, length + BLOCK)):
            solid.append((2, gmsh.model.occ.addRectangle(low, -top, 0, high - low, 2 * top)))
        whole, _ = gmsh.model.occ.fuse(solid[:1], solid[1:])
        holes = [_polygon(cells.hexagon(-0.5 * cells.wall) + centre) for centre in cells.centres()]
        gmsh.model.occ.cut(whole, holes)
        gmsh.model.occ.synchronize()
        _fine_between(0.0, length, edge_length)
        return _generated("the auxetic bar")
    finally:
        gmsh.finalize()


def mesh_cell(cells: Cells, edge_length: float) -> Mesh:
    """The part of the endless pattern from which reflections make the whole of it: from the middle of a cell to its
    right upright wall, and to the middle of the upright walls above; x from 0 to half a width, y from 0 to the
    pitch."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        whole = [(2, gmsh.model.occ.addRectangle(0, 0, 0, cells.half_width, cells.pitch))]
        inner, above = cells.hexagon(-0.5 * cells.wall), np.array([cells.half_width, cells.pitch])
        gmsh.model.occ.cut(whole, [_polygon(inner), _polygon(inner + above)])
        gmsh.model.occ.synchronize()
        _fine_between(0.0, cells.half_width, edge_length)
        return _generated("the cell")
    finally:
        gmsh.finalize()


def _generated(name: str) -> Mesh:
    gmsh.model.mesh.generate(2)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(2)
    index = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    index[tags.astype(np.int64)] = np.arange(len(tags))
    points = coordinates.reshape(-1, 3)[:, :2]
    return in_morton_order(oriented_mesh(points, index[nodes.astype(np.int64)].reshape(-1, 3), name))


def _offset(corners: Array, distance: float) -> Array:
    """A polygon, anticlockwise, with each side moved outwards by `distance`."""
    along = np.roll(corners, -1, axis=0) - corners
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    before = np.roll(normal, 1, axis=0)
    # The corner keeps the distance from both of its sides.
    return corners + distance * (normal + before) / (1.0 + np.sum(normal * before, axis=1))[:, None]


def _fine_between(low: float, high: float, edge_length: float) -> None:
    """This edge length [m] from x = low to high, and larger ones in the blocks, which are rigid."""
    box = gmsh.model.mesh.field.add("Box")
    limits = {"XMin": low, "XMax": high, "YMin": -1.0, "YMax": 1.0, "Thickness": BLOCK}
    for name, value in {"VIn": edge_length, "VOut": 4.0 * edge_length, **limits}.items():
        gmsh.model.mesh.field.setNumber(box, name, value)
    gmsh.model.mesh.field.setAsBackgroundMesh(box)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)


def _polygon(corners: Array) -> tuple[int, int]:
    points = [gmsh.model.occ.addPoint(x, y, 0) for x, y in corners]
    sides = [
        gmsh.model.occ.addLine(one, other)
        for one, other in zip(points, [*points[1:], points[0]], strict=True)
    ]
    return 2, gmsh.model.occ.addPlaneSurface([gmsh.model.occ.addCurveLoop(sides)])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--small", action="store_true", help="fewer cells, of thicker walls")
    parser.add_argument("--edge-length", type=float, help="edge length [m] (default: about half a wall)")
    parser.add_argument("--out", type=Path, required=True, help="mesh file to write (.vtu, .msh, ...)")
    arguments = parser.parse_args()
    cells = SMALL if arguments.small else FULL
    mesh = mesh_auxetic(cells, arguments.edge_length or 0.48 * cells.wall)
    write_mesh(arguments.out, mesh)
    print(f"{arguments.out}: {mesh.n_nodes} nodes, {mesh.n_cells} cells")


if __name__ == "__main__":
    run_script(main)
