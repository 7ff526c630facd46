"""Mesh the Hand: the inside of the skin of `hand_skin.py`. Needs gmsh, and npm to fetch the skin.

    python meshes/hand.py --fingers 0.0037 --palm 0.0070 --bones 0.0036 --inside 0.0100 --out meshes/hand_small.vtu
    python meshes/hand.py --fingers 0.00168 --palm 0.0028 --bones 0.0026 --inside 0.0034 --out meshes/hand.vtu

It lies with its palm down (-z), its fingers along x and its thumb to +y, as the skin does. Lengths in metres.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import igl
import numpy as np
from hand_bones import RADIUS, marrow
from hand_skin import Skin, read_skin
from scipy.spatial import cKDTree
from solid_mesh import GROWTH, mesh_solid

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.mesh import write_mesh
from softprint.runtime.shapes.solid import Field

ROOM = 0.006  # around the skin


def inside_of(skin: Skin) -> Field:
    """Signed distance to the skin, subdivided once (Loop), so that its facets do not show."""
    vertices, triangles = igl.loop(skin.vertices, skin.triangles, 1)

    def field(points: Array) -> Array:
        return np.asarray(igl.signed_distance(points, vertices, triangles)[0])

    return field


def finger_joints(skin: Skin) -> Array:
    """(j, 3) the joints of the fingers and the outer ones of the thumb [m]."""
    return np.array([place for name, place in skin.joints.items() if "phalanx" in name or "tip" in name])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--fingers", type=float, required=True, help="edge length at the fingers [m]")
    parser.add_argument("--palm", type=float, required=True, help="edge length far from the fingers [m]")
    parser.add_argument("--bones", type=float, required=True, help="edge length in the bones [m]")
    parser.add_argument("--inside", type=float, required=True, help="largest edge length inside [m]")
    parser.add_argument("--package", type=Path, help="folder that holds the npm package, or is to hold it")
    parser.add_argument("--out", type=Path, required=True, help="mesh file to write (.vtu, .msh, ...)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        skin = read_skin(arguments.package or Path(scratch))
    near = cKDTree(finger_joints(skin))

    def size(point: Array) -> float:
        """Fine within 15 mm of a joint of a finger, coarse from 45 mm on."""
        share = np.clip((near.query(point)[0] - 0.015) / 0.030, 0.0, 1.0)
        return float(arguments.fingers + share * (arguments.palm - arguments.fingers))

    bone = cKDTree(marrow(skin, 0.001))

    def inside(point: Array) -> float:
        """Fine in bones too, slim as they are: else they had too few nodes to be rigid frames."""
        beyond = max(0.0, bone.query(point)[0] - RADIUS)
        return float(min(arguments.inside, arguments.bones + GROWTH * beyond))

    lower, upper = skin.vertices.min(axis=0) - ROOM, skin.vertices.max(axis=0) + ROOM
    mesh = mesh_solid(inside_of(skin), lower, upper, size, inside, spacing=0.0015)
    write_mesh(arguments.out, mesh)
    print(f"{arguments.out}: {mesh.n_nodes} nodes, {mesh.n_cells} tetrahedra")


if __name__ == "__main__":
    run_script(main)
