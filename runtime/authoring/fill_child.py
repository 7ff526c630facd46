"""The process in which fTetWild runs: `python -m softprint.runtime.authoring.fill_child SURFACE.npz CELLS.npz`."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from softprint.runtime.arrays import Array, IntArray

# Half of the width of the envelope, as a share of the edge length of cells: far below what cells of that size can show,
# and wide enough to drop triangles that are much smaller than the cells.
ENVELOPE = 0.1
# Volume of a cell of edge one, as fTetWild makes them inside thick bodies.
CELL_VOLUME = 0.085
# The number of cells is right within CLOSE; otherwise the nearest of TRIES attempts is taken.
CLOSE, TRIES = 0.2, 5
# Thin parts and fine features need some cells at any edge length, so that the number depends less on it than by the
# cube.
_LEAST_SLOPE, _MOST_SLOPE = 0.8, 3.5

Fill = Callable[[float], tuple[Array, IntArray]]


def main(given: str, made: str) -> None:
    """Reads vertices, triangles, the number of cells wanted and the volume; writes points, cells and the edge
    length."""
    from pytetwild.pytetwild import tetrahedralize

    with np.load(given, allow_pickle=False) as arrays:
        vertices = np.ascontiguousarray(arrays["vertices"], dtype=np.float64)
        triangles = np.ascontiguousarray(arrays["triangles"], dtype=np.int32)
        wanted, volume = int(arrays["wanted"]), float(arrays["volume"])
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))

    def fill(edge: float) -> tuple[Array, IntArray]:
        result = tetrahedralize(
            vertices, triangles, edge_length_abs=edge, epsilon=ENVELOPE * edge / diagonal, num_threads=1
        )
        return result[0], result[1].astype(np.int64)

    points, cells, edge = of_wanted_number(fill, wanted, (volume / (wanted * CELL_VOLUME)) ** (1.0 / 3.0))
    np.savez(made, points=points, cells=cells, edge=edge)


def of_wanted_number(fill: Fill, wanted: int, edge: float) -> tuple[Array, IntArray, float]:
    """Points, cells and edge length of a filling of about `wanted` cells, from a first guess at the edge length: a
    secant method in the logarithms of number and edge length."""
    tried: list[tuple[Array, IntArray, float]] = []
    while True:
        tried.append((*fill(edge), edge))
        off = [abs(np.log(max(len(cells), 1) / wanted)) for _, cells, _ in tried]
        best = tried[int(np.argmin(off))]
        if len(tried) == TRIES or abs(len(best[1]) / wanted - 1.0) <= CLOSE:
            return best
        count, slope = max(len(tried[-1][1]), 1), 3.0
        if len(tried) > 1:
            before = tried[-2]
            change = np.log(edge / before[2])
            slope = -np.log(count / max(len(before[1]), 1)) / change if change else slope
        edge *= (count / wanted) ** (1.0 / float(np.clip(slope, _LEAST_SLOPE, _MOST_SLOPE)))


if __name__ == "__main__":
    main(*sys.argv[1:])
