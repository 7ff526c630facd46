"""Mesh the Worm, a soft robot in the plane with three bones (thesis, figure 4.10). Needs gmsh.

    python meshes/worm.py --cells 20200 --out meshes/worm.vtu
    python meshes/worm.py --cells 4000 --out meshes/worm_small.vtu

It lies along x from its tail at the origin to its head, 180 mm long and 32 mm high, with waists between its three
segments. Lengths in metres. `BONES` says where its bones are, which the examples make rigid frames of.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.authoring.fill_outline import filled_outline
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import in_morton_order, write_mesh

LENGTH, SEGMENT = 0.180, 0.060
HALF_HEIGHT, WAIST = 0.016, 0.003  # WAIST: how much lower it is between two segments
BONES = {
    name: ((middle - 0.014, 0.0), (middle + 0.014, 0.0), 0.004)
    for name, middle in (("tail", 0.030), ("middle", 0.090), ("head", 0.150))
}


def half_height(x: Array) -> Array:
    """(n,) [m] at places along the worm (n,): waists, and round ends."""
    along = HALF_HEIGHT - 0.5 * WAIST * (1.0 + np.cos(2 * np.pi * x / SEGMENT))
    to_end = np.clip(1.0 - np.minimum(x, LENGTH - x) / HALF_HEIGHT, 0.0, 1.0)
    return np.asarray(along * np.sqrt(1.0 - to_end**2))


def outline(edge_length: float) -> Array:
    """Corners (n, 2) [m], anticlockwise, about so far apart."""
    angle = np.linspace(0.0, 2 * np.pi, 20001)[:-1]
    x = 0.5 * LENGTH * (1.0 - np.cos(angle))
    curve = np.column_stack([x, np.where(angle > np.pi, 1.0, -1.0) * half_height(x)])
    closed = np.vstack([curve, curve[:1]])
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, walked[-1], round(walked[-1] / edge_length) + 1)[:-1]
    return np.column_stack([np.interp(at, walked, closed[:, axis]) for axis in (0, 1)])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cells", type=int, required=True, help="about how many triangles")
    parser.add_argument("--out", type=Path, required=True, help="mesh file to write (.vtu, .msh, ...)")
    arguments = parser.parse_args()
    area = 2.0 * float(half_height(np.linspace(0.0, LENGTH, 4001)).mean() * LENGTH)
    edge = np.sqrt(area / (max(arguments.cells, 1) * np.sqrt(3.0) / 4.0))
    try:
        mesh = in_morton_order(filled_outline([outline(edge)], arguments.cells, "the worm"))
    except SoftprintError as error:
        parser.error(str(error))
    write_mesh(arguments.out, mesh)
    print(f"{arguments.out}: {mesh.n_nodes} nodes, {mesh.n_cells} triangles")


if __name__ == "__main__":
    run_script(main)
