"""How far the answers of full space differ when nothing differs but the facets under a shape.

    python -m benchmarks.reference_floor examples/jelly_library_small.toml [--out RUN] [--shapes fork ...] [--turn 37]

The Jelly is a body of revolution, so to turn a shape and its path about the axis turns the answer. Its mesh is not: the
shape meets other facets. Each of the motions of `benchmarks.thin_shapes` is played in full space as it is, and turned;
the second answer is turned back, and compared at the nodes of the first. No model can be judged to be nearer to full
space than that. Off and force are those of that benchmark:

    off = sqrt(mean |x - x_full|^2), as a share of that of the bare subspace
    force = sqrt(mean |f - f_full|^2) / sqrt(mean |f_full|^2)
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyvista

from benchmarks.thin_shapes import SHAPES, Bench, about_the_axis, rms, shape_of
from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.mesh import Mesh


def turned_back(x: Array, mesh: Mesh, turn: float) -> Array:
    """Positions (t, n_nodes, 3) [m] of a motion that was turned, as if it had not been."""
    rotation = about_the_axis(turn)
    cells, weights = places(mesh, mesh.points @ rotation.T)
    there = np.einsum("nc,tncd->tnd", weights, (x - mesh.points)[:, mesh.cells[cells]])
    return np.asarray(mesh.points + there @ rotation)


def places(mesh: Mesh, points: Array) -> tuple[Array, Array]:
    """Cells (n,) and barycentric coordinates (n, 4) of points (n, 3); of the nearest cell for points outside, which are
    so by the height of a facet's arc."""
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: mesh.cells}, mesh.points)
    cells = np.asarray(grid.find_containing_cell(points))
    outside = cells < 0
    cells[outside] = grid.find_closest_cell(points[outside])
    corners = mesh.points[mesh.cells[cells]]
    edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    inner = np.linalg.solve(edges, (points - corners[:, 0])[..., None])[..., 0]
    return cells, np.column_stack([1.0 - inner.sum(axis=1), inner])


def main(words: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown, row by row."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="the run directory; default: runs/NAME")
    parser.add_argument("--shapes", nargs="+", default=SHAPES, choices=SHAPES, metavar="NAME")
    parser.add_argument("--turn", type=float, default=37.0, help="degrees (default: 37)")
    parser.add_argument("--depth", type=float, default=0.004, help="m, below the undeformed top")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the experiment")
    given = parser.parse_args(words)
    logging.getLogger("softprint").setLevel(logging.ERROR)
    run = given.out or Path("runs") / given.experiment.stem
    bench = Bench(load_experiment(given.experiment, given.set), run, given.depth)
    turn = np.radians(given.turn)
    print(
        "| shape | force, N | bare off, mm | full space, turned: off, force | unconverged | mechanics: off, force |"
    )
    print("| --- " * 6 + "|", flush=True)
    for name in given.shapes:
        try:
            shape = shape_of(name)
        except SoftprintError as error:
            print(f"| {name} | {error} |", flush=True)
            continue
        full, bare = bench.play(shape, "full"), bench.play(shape, "bare")
        other, mechanics = bench.play(shape, "full", turn), bench.play(shape, "mechanics")
        x, force = turned_back(other.x, bench.body.mesh, turn), other.force @ about_the_axis(turn)
        there = np.abs(full.force).sum(axis=1) > 0.0
        whole, strength = rms((bare.x - full.x)[there]), rms(full.force[there])
        cells = [name, f"{strength:.2f}", f"{1e3 * whole:.2f}"]
        for own_x, own_force in ((x, force), (mechanics.x, mechanics.force)):
            off, missed = (
                rms((own_x - full.x)[there]) / whole,
                rms((own_force - full.force)[there]) / strength,
            )
            cells.append(f"{off:.0%}, {missed:.0%}")
        cells.insert(4, f"{full.unconverged}, {other.unconverged}")
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    run_script(main)
