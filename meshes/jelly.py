"""Mesh the Jelly, a flan on its base: a truncated cone with a rounded top edge (3D), or its profile (2D).
Needs gmsh.

    python meshes/jelly.py --dim 3 --edge-length 0.0034 --inside 0.0085 --out meshes/jelly3d_small.vtu
    python meshes/jelly.py --dim 3 --edge-length 0.0029 --out meshes/jelly3d.vtu
    python meshes/jelly.py --dim 2 --edge-length 0.000945 --out meshes/jelly2d.vtu
    python meshes/jelly.py --dim 2 --edge-length 0.0018 --out meshes/jelly2d_small.vtu

The base lies in z = 0 (y = 0 in 2D), centred on the axis; the last axis points up. Lengths in metres.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gmsh
import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.mesh import Mesh, in_morton_order, oriented_mesh, write_mesh

BASE_RADIUS, TOP_RADIUS, HEIGHT, FILLET = 0.05, 0.038, 0.06, 0.01


def rounded_corner() -> tuple[Array, Array, Array]:
    """Where the fillet leaves the side, its centre, and where it meets the top: (radius, height) each."""
    corner = np.array([TOP_RADIUS, HEIGHT])
    down = np.array([BASE_RADIUS - TOP_RADIUS, -HEIGHT]) / np.hypot(BASE_RADIUS - TOP_RADIUS, HEIGHT)
    half_angle = 0.5 * np.arccos(-down[0])  # between the side and the top, which runs along (-1, 0)
    tangent = FILLET / np.tan(half_angle)
    inward = (down + np.array([-1.0, 0.0])) / (2 * np.cos(half_angle))
    return corner + tangent * down, corner + FILLET / np.sin(half_angle) * inward, corner - [tangent, 0.0]


def profile(side: int) -> list[int]:
    """Curves from the middle of the base to that of the top: base, side, fillet, top (side = 1 or -1)."""
    add = gmsh.model.occ.addPoint
    leaves, centre, meets = (add(side * radius, height, 0) for radius, height in rounded_corner())
    foot, bottom, top = add(side * BASE_RADIUS, 0, 0), add(0, 0, 0), add(0, HEIGHT, 0)
    arc = gmsh.model.occ.addCircleArc(leaves, centre, meets)
    gmsh.model.occ.remove([(0, centre)])
    line = gmsh.model.occ.addLine
    return [line(bottom, foot), line(foot, leaves), arc, line(meets, top)]


def trapezoid() -> list[int]:
    """The 2D body; returns its boundary curves."""
    curves = profile(1) + profile(-1)
    gmsh.model.occ.addPlaneSurface([gmsh.model.occ.addCurveLoop(curves)])
    gmsh.model.occ.removeAllDuplicates()
    gmsh.model.occ.synchronize()
    return [curve for _, curve in gmsh.model.getEntities(1)]


def cone() -> list[int]:
    """The 3D body: half the profile turned about the axis, then stood upright; returns its side and top."""
    curves = profile(1)
    axis = gmsh.model.occ.addLine(gmsh.model.occ.addPoint(0, HEIGHT, 0), gmsh.model.occ.addPoint(0, 0, 0))
    face = gmsh.model.occ.addPlaneSurface([gmsh.model.occ.addCurveLoop([*curves, axis])])
    solid = [
        entity
        for entity in gmsh.model.occ.revolve([(2, face)], 0, 0, 0, 0, 1, 0, 2 * np.pi)
        if entity[0] == 3
    ]
    gmsh.model.occ.rotate(solid, 0, 0, 0, 1, 0, 0, np.pi / 2)
    gmsh.model.occ.remove([(2, face)], recursive=True)
    gmsh.model.occ.removeAllDuplicates()
    gmsh.model.occ.synchronize()
    boundary = gmsh.model.getBoundary(gmsh.model.getEntities(3), oriented=False)
    # The base is held: nothing presses there, so only the side and the top are worth fine elements.
    return [tag for kind, tag in boundary if gmsh.model.occ.getCenterOfMass(kind, tag)[2] > 1e-6]


def mesh_jelly(dim: int, edge_length: float, inside: float) -> Mesh:
    """The jelly: this edge length at the surface [m], ``inside`` [m] from a third of its height deep."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        boundary = cone() if dim == 3 else trapezoid()
        distance = gmsh.model.mesh.field.add("Distance")
        gmsh.model.mesh.field.setNumbers(distance, "SurfacesList" if dim == 3 else "CurvesList", boundary)
        gmsh.model.mesh.field.setNumber(distance, "Sampling", 60)
        grading = gmsh.model.mesh.field.add("Threshold")
        limits = {"SizeMin": edge_length, "SizeMax": inside, "DistMin": 0.0, "DistMax": HEIGHT / 3}
        for name, value in {"InField": distance, **limits}.items():
            gmsh.model.mesh.field.setNumber(grading, name, value)
        gmsh.model.mesh.field.setAsBackgroundMesh(grading)
        for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.option.setNumber("Mesh.OptimizeNetgen", int(dim == 3))
        gmsh.model.mesh.generate(dim)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, nodes = gmsh.model.mesh.getElementsByType(4 if dim == 3 else 2)
    finally:
        gmsh.finalize()
    index = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    index[tags.astype(np.int64)] = np.arange(len(tags))
    points = coordinates.reshape(-1, 3)[:, :dim]
    return in_morton_order(
        oriented_mesh(points, index[nodes.astype(np.int64)].reshape(-1, dim + 1), "the jelly")
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--dim", type=int, choices=(2, 3), required=True)
    parser.add_argument("--edge-length", type=float, required=True, help="edge length at the surface [m]")
    parser.add_argument("--inside", type=float, help="edge length inside [m] (default: as at the surface)")
    parser.add_argument("--out", type=Path, required=True, help="mesh file to write (.vtu, .msh, ...)")
    arguments = parser.parse_args()
    mesh = mesh_jelly(arguments.dim, arguments.edge_length, arguments.inside or arguments.edge_length)
    write_mesh(arguments.out, mesh)
    print(f"{arguments.out}: {mesh.n_nodes} nodes, {mesh.n_cells} cells")


if __name__ == "__main__":
    run_script(main)
