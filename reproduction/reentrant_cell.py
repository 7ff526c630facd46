"""Poisson's ratio of re-entrant cells in the linear limit, by finite elements and by the formula of Gibson and Ashby.

    python -m reproduction.reentrant_cell

Gibson and Ashby, Cellular Solids (1997), chapter 4: a honeycomb with upright walls h and slanted walls l at the angle
theta, of thickness t, pulled across its upright walls. Its walls bend, stretch and shear as Timoshenko beams, and

    nu_12 = cos^2 theta / ((h/l + sin theta) sin theta)
            (1 + (1.4 + 1.5 nu) (t/l)^2) / (1 + (2.4 + 1.5 nu + cot^2 theta) (t/l)^2),

with the second line for walls that are not slender, and nu of the solid; in plane strain nu / (1 - nu). In finite
elements the smallest part of the pattern has symmetry on three sides, and a free straight fourth one. What the beams do
not have is the size of their joints, t: a slanted wall is shorter by about t / l of its length. So the formula and
finite elements approach each other as the walls become thinner.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from meshes.auxetic import FULL, Cells, mesh_cell
from softprint.runtime.cli.script import run_script
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.compliance.null_space_compliance import elastic_stiffness

POISSON = 0.4


def formula(cells: Cells, poisson: float = POISSON, slender: bool = False) -> float:
    """nu_12 of the cells, of a solid in plane strain; slender: of walls that bend alone."""
    nu, ratio, sine = poisson / (1.0 - poisson), cells.wall / cells.slanted, np.sin(cells.angle)
    bending = np.cos(cells.angle) ** 2 / ((cells.upright / cells.slanted + sine) * sine)
    if slender:
        return float(bending)
    above = 1.0 + (1.4 + 1.5 * nu) * ratio**2
    return float(bending * above / (1.0 + (2.4 + 1.5 * nu + np.tan(cells.angle) ** -2) * ratio**2))


def homogenised(cells: Cells, walls: int, poisson: float = POISSON) -> float:
    """nu_12 by finite elements, with this many triangles across a wall."""
    mesh = mesh_cell(cells, cells.wall / walls)
    material = make_material("linear", np.full(mesh.n_cells, 1.0), np.full(mesh.n_cells, poisson))
    K = elastic_stiffness(mesh, material)
    x, y = mesh.points.T
    width, height, tiny = cells.half_width, cells.pitch, 1e-9
    # u = T v + pulled: no normal motion at x = 0 and y = 0, one at x = width, and a common one at y = height.
    free = np.column_stack([(x > tiny) & (x < width - tiny), (y > tiny) & (y < height - tiny)]).ravel()
    top = np.column_stack([np.zeros(len(y)), y >= height - tiny]).ravel()
    pulled = np.column_stack([np.where(x >= width - tiny, width, 0.0), np.zeros(len(x))]).ravel()
    T = sp.hstack([sp.identity(len(free), format="csr")[:, free], top[:, None]], format="csr")
    v = spsolve((T.T @ K @ T).tocsc(), -T.T @ (K @ pulled))
    return float(-v[-1] / height)


def main() -> None:
    print("| t / l | finite elements | formula | slender walls |\n| --- | --- | --- | --- |")
    for share in (0.14, 0.07, 0.035):
        cells = replace(FULL, wall=share * FULL.slanted)
        found, beams, slender = homogenised(cells, 8), formula(cells), formula(cells, slender=True)
        print(f"| {share} | {found:.3f} | {beams:.3f} | {slender:.3f} |")


if __name__ == "__main__":
    run_script(main)
