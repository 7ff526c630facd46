"""Mesh the Floater, a ring of genus 1 (thesis, figure 5.9), and the shell that passes through it. Needs gmsh.

    python meshes/floater.py --edge-length 0.0042 --inside 0.0075 --out meshes/floater_small.vtu
    python meshes/floater.py --edge-length 0.0022 --inside 0.0035 --out meshes/floater.vtu
    python meshes/floater.py --shell meshes/shell.stl

The ring lies about the z axis, its middle at the origin: 45 mm from the axis to the middle of its tube, which is 14 mm
thick at the radius. The shell is a spindle about the z axis with nine ribs, wider than the hole where it is widest.
Lengths in metres.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import trimesh
from field_grid import Grid
from solid_mesh import mesh_solid

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.mesh import write_mesh
from softprint.runtime.shapes.solid import Field, torus

RADIUS, TUBE = 0.045, 0.014  # of the ring; its hole has a radius of 31 mm
RIBS, RIB_HEIGHT = 9, 0.004
WIDEST, HALF_LENGTH = 0.030, 0.050  # of the shell without its ribs


def shell() -> Field:
    """A spindle r = w cos^2(pi z / 2 l), with ribs along it."""

    def field(p: Array) -> Array:
        along = np.clip(p[:, 2] / HALF_LENGTH, -1.0, 1.0)
        profile = np.cos(0.5 * np.pi * along) ** 2
        ribs = 0.5 * (1.0 + np.cos(RIBS * np.arctan2(p[:, 1], p[:, 0])))
        radius = profile * (WIDEST + RIB_HEIGHT * ribs) + 0.003
        beyond = np.maximum(np.abs(p[:, 2]) - HALF_LENGTH, 0.0)
        return np.asarray(np.hypot(np.hypot(p[:, 0], p[:, 1]), beyond) - radius)

    return field


def write_shell(path: Path, spacing: float = 0.0022) -> None:
    """Its surface, by marching cubes."""
    far = np.array([WIDEST + RIB_HEIGHT + 0.006, WIDEST + RIB_HEIGHT + 0.006, HALF_LENGTH + 0.006])
    grid = Grid(shell(), -far, far, spacing)
    vertices, triangles = grid.zero_level()
    mesh = trimesh.Trimesh(vertices, triangles)
    mesh.fix_normals()
    mesh.export(path)
    print(f"{path}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles, closed: {mesh.is_watertight}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--edge-length", type=float, help="edge length at the surface [m]")
    parser.add_argument("--inside", type=float, help="edge length in the middle of the tube [m]")
    parser.add_argument("--out", type=Path, help="mesh file to write (.vtu, .msh, ...)")
    parser.add_argument("--shell", type=Path, metavar="FILE.stl", help="write the shell instead")
    given = parser.parse_args()
    if given.shell is not None:
        write_shell(given.shell)
        return
    if None in (given.edge_length, given.inside, given.out):
        parser.error("give --edge-length, --inside and --out, or --shell")
    far = np.array([RADIUS + TUBE + 0.005, RADIUS + TUBE + 0.005, TUBE + 0.005])
    mesh = mesh_solid(
        torus(RADIUS, TUBE),
        -far,
        far,
        lambda _: float(given.edge_length),
        lambda _: float(given.inside),
        spacing=0.001,
    )
    write_mesh(given.out, mesh)
    print(f"{given.out}: {mesh.n_nodes} nodes, {mesh.n_cells} tetrahedra")


if __name__ == "__main__":
    run_script(main)
