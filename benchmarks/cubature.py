"""Cubature of the Jelly: force and energy errors of three kinds of weights, and what building the body costs.

    python -m benchmarks.cubature [--mesh meshes/jelly3d.vtu]

Same cells, other weights: those fitted to the moments of the basis gradients (ours), the integrals of the
samples' biharmonic coordinates (thesis eq. 3.14), and the volumes of the samples' Voronoi regions.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from softprint.runtime.body import frame_in_box, place_handles
from softprint.runtime.body.basis import biharmonic_basis
from softprint.runtime.body.cubature import (
    choose_cubature,
    cubature_error,
    elastic_cells,
    interpolation_weights,
    nearest_volumes,
    random_states,
)
from softprint.runtime.cli.script import run_script
from softprint.runtime.elasticity import make_material
from softprint.runtime.mesh import read_mesh

DEFAULT_MESH = Path(__file__).parent.parent / "meshes" / "jelly3d_small.vtu"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=DEFAULT_MESH, help="a Jelly (default: %(default)s)")
    parser.add_argument("--points", type=int, help="point handles (default: 18 in 3D, 8 in 2D)")
    parser.add_argument("--seed", type=int, default=0, help="of the states to measure with (default: 0)")
    arguments = parser.parse_args()

    mesh = read_mesh(arguments.mesh)
    box = [[-1.0] * mesh.dim, [1.0] * (mesh.dim - 1) + [0.007]]
    handles = place_handles(
        mesh, arguments.points or {2: 8, 3: 18}[mesh.dim], [frame_in_box(mesh, "base", box)]
    )
    material = make_material("stable_neo_hookean", np.full(mesh.n_cells, 2e4), np.full(mesh.n_cells, 0.4))
    start = time.perf_counter()
    basis = biharmonic_basis(mesh, handles)
    print(
        f"{arguments.mesh.name}: {mesh.n_cells} cells, {handles.n_rows} rows; basis "
        f"{time.perf_counter() - start:.2f} s"
    )

    states = random_states(mesh, handles, np.random.default_rng(arguments.seed))
    elastic = elastic_cells(mesh, handles)
    print(
        f"{'points a row':>12} {'cells':>6} {'weights':>14} {'energy error':>13} {'force error':>12} "
        f"{'negative':>9} {'seconds':>8}"
    )
    for per_row in (5, 10, 20):
        start = time.perf_counter()
        cells, ours = choose_cubature(mesh, basis, handles, material, per_row * handles.n_rows)
        seconds = {"moments": time.perf_counter() - start, "nearest volume": float("nan")}
        weights = {"moments": ours, "nearest volume": nearest_volumes(mesh, elastic, cells)}
        start = time.perf_counter()
        weights["thesis 3.14"] = interpolation_weights(mesh, cells)
        seconds["thesis 3.14"] = time.perf_counter() - start
        for name, values in weights.items():
            energy, force = cubature_error(mesh, basis, handles, material, cells, values, states)
            print(
                f"{per_row:12d} {len(cells):6d} {name:>14} {energy:13.2%} {force:12.2%} "
                f"{(values < 0).sum():9d} "
                f"{seconds[name]:8.2f}"
            )


if __name__ == "__main__":
    run_script(main)
