"""A bar of stripes of two stiffnesses (thesis, figure 4.8): the geometry; the stiffnesses are in the experiment.

    python meshes/accordion.py --edge-length 0.001 --out meshes/accordion.vtu
    python meshes/accordion.py --edge-length 0.0025 --out meshes/accordion_small.vtu

21 stripes of 10 mm, stiff and soft in turn along x, 40 mm high. Triangles are halves of squares, with diagonals that
alternate so that the mesh has no preferred direction. No triangle lies in two stripes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh, in_morton_order, oriented_mesh, write_mesh

STRIPES, STRIPE, HEIGHT = 21, 0.010, 0.040  # m


def mesh_accordion(edge_length: float) -> Mesh:
    """The bar, from x = 0 and with y = 0 in its middle; edge_length: sides of the squares [m], which must divide a
    stripe and the height. Raises SoftprintError where it does not."""
    along, up = STRIPE / edge_length, HEIGHT / edge_length
    if min(along, up) < 1 or not np.allclose([along, up], np.round([along, up]), rtol=1e-9):
        raise SoftprintError(
            f"--edge-length {edge_length}: must divide a stripe ({STRIPE} m) and the height ({HEIGHT} m)"
        )
    n, m = STRIPES * round(along), round(up)
    x, y = np.linspace(0.0, STRIPES * STRIPE, n + 1), np.linspace(-0.5 * HEIGHT, 0.5 * HEIGHT, m + 1)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    a = i * (m + 1) + j
    b, c, d = a + m + 1, a + m + 2, a + 1
    rising = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1)
    falling = np.stack([np.stack([a, b, d], 1), np.stack([b, c, d], 1)], 1)
    cells = np.where(((i + j) % 2 == 0)[:, None, None], rising, falling).reshape(-1, 3)
    return in_morton_order(oriented_mesh(points, cells, "the accordion"))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--edge-length", type=float, required=True, help="sides of the squares [m]")
    parser.add_argument("--out", type=Path, required=True, help="mesh file to write (.vtu, .msh, ...)")
    arguments = parser.parse_args()
    try:
        mesh = mesh_accordion(arguments.edge_length)
    except SoftprintError as error:
        parser.error(str(error))
    write_mesh(arguments.out, mesh)
    print(f"{arguments.out}: {mesh.n_nodes} nodes, {mesh.n_cells} cells")


if __name__ == "__main__":
    run_script(main)
