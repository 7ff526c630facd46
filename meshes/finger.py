"""Mesh the Finger, the two outer segments of one, cut off flat behind. Needs gmsh.

    python meshes/finger.py --pad 0.0008 --edge-length 0.0015 --inside 0.0021 --out meshes/finger_small.vtu
    python meshes/finger.py --pad 0.00047 --edge-length 0.0011 --inside 0.0015 --out meshes/finger.vtu

It lies along x from its cut at the origin to its tip, with the pad below (-z). Lengths in metres. `BONES` says where
its two bones are, which the examples make rigid frames of.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from solid_mesh import mesh_solid, smooth_maximum

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.mesh import write_mesh
from softprint.runtime.shapes.solid import Field, blended, capsule, ellipsoid, moved

LENGTH, CUT_ROUNDING = 0.052, 0.0015
FILLET = 0.0015
PAD = np.array([0.0425, 0.0, -0.0052])  # the middle of the pad, where the fine elements are
BONES = {
    "middle": ((0.000, 0.0, 0.0008), (0.0215, 0.0, 0.0008), 0.0034),
    "distal": ((0.0305, 0.0, 0.0010), (0.0415, 0.0, 0.0008), 0.0026),
}


def finger() -> Field:
    behind = capsule((-0.010, 0, 0), (0.0260, 0, 0), 0.0086, 0.0078)
    joint = moved(ellipsoid((0.0085, 0.0086, 0.0080)), (0.0260, 0, 0.0002))
    end = capsule((0.0260, 0, 0), (0.0448, 0, 0.0004), 0.0076, 0.0064)
    pad = moved(ellipsoid((0.0115, 0.0076, 0.0066)), (0.0400, 0, -0.0016))
    whole = blended(FILLET, behind, joint, end, pad)
    return lambda p: smooth_maximum(whole(p), -p[:, 0], CUT_ROUNDING)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pad", type=float, required=True, help="edge length at the pad [m]")
    parser.add_argument("--edge-length", type=float, required=True, help="edge length far from the pad [m]")
    parser.add_argument("--inside", type=float, required=True, help="largest edge length inside [m]")
    parser.add_argument("--out", type=Path, required=True, help="mesh file to write (.vtu, .msh, ...)")
    arguments = parser.parse_args()

    def size(point: Array) -> float:
        """Fine within 8 mm of the middle of the pad, coarse from 16 mm on."""
        share = np.clip((np.linalg.norm(point - PAD) - 0.008) / 0.008, 0.0, 1.0)
        return float(arguments.pad + share * (arguments.edge_length - arguments.pad))

    lower, upper = np.array([-0.002, -0.011, -0.012]), np.array([LENGTH + 0.002, 0.011, 0.011])
    mesh = mesh_solid(finger(), lower, upper, size, lambda _: arguments.inside, spacing=0.0004)
    write_mesh(arguments.out, mesh)
    print(f"{arguments.out}: {mesh.n_nodes} nodes, {mesh.n_cells} tetrahedra")


if __name__ == "__main__":
    run_script(main)
