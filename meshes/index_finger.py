"""Mesh the Index finger: three segments and the part of the palm that they grow from (thesis, figure 4.12). Needs gmsh.

    python meshes/index_finger.py --edge-length 0.0034 --inside 0.0042 --out meshes/index_finger_small.vtu
    python meshes/index_finger.py --edge-length 0.00255 --inside 0.0030 --out meshes/index_finger.vtu
    python meshes/index_finger.py --balls meshes

It points along x, slightly bent, with the pads below (-z); the palm is at the origin. Lengths in metres. `BONES` says
where its bones are, which the examples make rigid frames of. --balls writes the spheres that it learns from.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh
from solid_mesh import mesh_solid

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.mesh import write_mesh
from softprint.runtime.shapes.solid import Field, blended, capsule, ellipsoid, moved

FILLET = 0.0015
JOINTS = np.array([[0.0, 0, 0], [0.022, 0, 0], [0.064, 0, -0.004], [0.090, 0, -0.010], [0.110, 0, -0.018]])
RADII = (0.0125, 0.0110, 0.0095, 0.0088, 0.0072)
BONES = {
    name: tuple(tuple((start + share * (end - start)).tolist()) for share in (0.15, 0.85))
    for name, start, end in zip(
        ("palm", "proximal", "middle", "distal"), JOINTS[:-1], JOINTS[1:], strict=True
    )
}
BALLS = (0.005, 0.007, 0.009, 0.011)  # radii [m]


def finger() -> Field:
    ends = zip(JOINTS[:-1], JOINTS[1:], RADII[:-1], RADII[1:], strict=True)
    segments = [capsule(start, end, near, far) for start, end, near, far in ends]
    pads = [
        moved(ellipsoid((0.013, 0.0085, 0.0065)), 0.5 * (start + end) + np.array([0.0, 0.0, -0.0045]))
        for start, end in pairwise(JOINTS[1:])
    ]
    return blended(FILLET, *segments, *pads)


def write_balls(folder: Path) -> None:
    """One STL for each radius, `ball_5mm.stl` to `ball_11mm.stl`."""
    for radius in BALLS:
        path = folder / f"ball_{round(1e3 * radius)}mm.stl"
        trimesh.creation.icosphere(subdivisions=3, radius=radius).export(path)
        print(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--edge-length", type=float, help="edge length at the surface [m]")
    parser.add_argument("--inside", type=float, help="edge length in the middle [m]")
    parser.add_argument("--out", type=Path, help="mesh file to write (.vtu, .msh, ...)")
    parser.add_argument("--balls", type=Path, metavar="FOLDER", help="write the spheres instead")
    given = parser.parse_args()
    if given.balls is not None:
        write_balls(given.balls)
        return
    if None in (given.edge_length, given.inside, given.out):
        parser.error("give --edge-length, --inside and --out, or --balls")
    lower, upper = np.array([-0.016, -0.016, -0.032]), np.array([0.121, 0.016, 0.016])

    def size(_: Array) -> float:
        return float(given.edge_length)

    mesh = mesh_solid(finger(), lower, upper, size, lambda _: float(given.inside), spacing=0.0006)
    write_mesh(given.out, mesh)
    print(f"{given.out}: {mesh.n_nodes} nodes, {mesh.n_cells} tetrahedra")


if __name__ == "__main__":
    run_script(main)
