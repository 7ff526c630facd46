"""Mesh the gel pad of a camera-based tactile sensor: a slab of soft silicone on a rigid back. Needs gmsh.

    python meshes/gel_pad.py --edge-length 0.0005 --rim 0.0014 --inside 0.0022 --out meshes/gel_pad_small.vtu
    python meshes/gel_pad.py --edge-length 0.00034 --rim 0.0010 --inside 0.0016 --out meshes/gel_pad.vtu

The gel is 25 x 25 x 4 mm, about the size of the pad of a GelSight Mini. It lies on z = 0, with the surface that touches
at z = 4 mm, centred on the axis; the back, which the experiments hold as a rigid frame, reaches from z = -1 mm to 0.
Edges are short in the middle of the surface that touches, and grow towards its rim and towards the back. Lengths in
metres.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gmsh
import numpy as np

from softprint.runtime.cli.script import run_script
from softprint.runtime.mesh import Mesh, in_morton_order, oriented_mesh, write_mesh

WIDTH, THICKNESS, BACK = 0.025, 0.004, 0.001
# The surface is fine up to the first distance from its middle, and as coarse as at its rim from the second on.
FINE, COARSE = 0.006, 0.0115


def mesh_gel_pad(edge_length: float, rim: float, inside: float) -> Mesh:
    """The pad: the edge length in the middle of the surface that touches, at its rim, and at the back [m]."""

    def size(point: np.ndarray) -> float:
        away = np.clip((np.hypot(*point[:2]) - FINE) / (COARSE - FINE), 0.0, 1.0)
        at_surface = edge_length + away * (rim - edge_length)
        depth = np.clip((THICKNESS - point[2]) / THICKNESS, 0.0, 1.0)
        return float(at_surface + depth**2 * (max(inside, at_surface) - at_surface))

    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        add, half = gmsh.model.occ.addBox, 0.5 * WIDTH
        gel = add(-half, -half, 0.0, WIDTH, WIDTH, THICKNESS)
        back = add(-half, -half, -BACK, WIDTH, WIDTH, BACK)
        gmsh.model.occ.fragment([(3, gel)], [(3, back)])
        gmsh.model.occ.synchronize()
        for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, there: size(np.array([x, y, z])))
        gmsh.option.setNumber("Mesh.OptimizeNetgen", 1)
        gmsh.model.mesh.generate(3)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, nodes = gmsh.model.mesh.getElementsByType(4)
    finally:
        gmsh.finalize()
    index = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    index[tags.astype(np.int64)] = np.arange(len(tags))
    points = coordinates.reshape(-1, 3).round(9)  # so that the nodes of the flat sides lie in them exactly
    return in_morton_order(oriented_mesh(points, index[nodes.astype(np.int64)].reshape(-1, 4), "the gel pad"))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--edge-length", type=float, required=True, help="edge length in the middle of the surface [m]"
    )
    parser.add_argument("--rim", type=float, required=True, help="edge length at the rim of the surface [m]")
    parser.add_argument("--inside", type=float, required=True, help="edge length at the back [m]")
    parser.add_argument("--out", type=Path, required=True, help="mesh file to write (.vtu, .msh, ...)")
    given = parser.parse_args()
    mesh = mesh_gel_pad(given.edge_length, given.rim, given.inside)
    write_mesh(given.out, mesh)
    top = int((mesh.points[:, 2] > THICKNESS - 1e-6).sum())
    print(
        f"{given.out}: {mesh.n_nodes} nodes, {mesh.n_cells} tetrahedra, {top} nodes on the surface that touches"
    )


if __name__ == "__main__":
    run_script(main)
