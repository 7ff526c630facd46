"""Fill a surface with tetrahedra: fTetWild (Hu et al. 2020), through `pytetwild`.

fTetWild takes any triangles, also ones that pass through each other, and keeps what lies inside by winding numbers.
The new surface stays within an envelope about the old one. It runs in a process of its own (`fill_child.py`):
whatever it does with a strange mesh, this process goes on. Why not gmsh: `docs/own_mesh.md` has the comparison.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.errors import SoftprintError

# A number of cells is right if it differs by no more than this share from the one wanted.
RIGHT = 0.25
_TIMEOUT = 3600.0  # s, on a busy machine
_LEAST_CELLS, _MOST_CELLS = 20, 1_000_000


@dataclass(frozen=True, eq=False)
class Filled:
    """points (n, 3), cells (m, 4) in the surface's unit, as fTetWild leaves them; edge: the edge length asked for."""

    points: Array
    cells: IntArray
    edge: float


def refuse_count(wanted: int) -> None:
    """Raises SoftprintError for a number of cells that makes no body."""
    if not _LEAST_CELLS <= wanted <= _MOST_CELLS:
        raise SoftprintError(f"--cells {wanted}: must be from {_LEAST_CELLS} to {_MOST_CELLS:,}")


def filled(vertices: Array, triangles: IntArray, wanted: int, volume: float, source: str) -> Filled:
    """About `wanted` tetrahedra inside a surface that encloses about `volume`. Raises SoftprintError if fTetWild does
    not end, or leaves nothing."""
    refuse_count(wanted)
    with tempfile.TemporaryDirectory(prefix="softprint-fill-") as folder:
        given, made = Path(folder) / "surface.npz", Path(folder) / "cells.npz"
        np.savez(given, vertices=vertices, triangles=triangles, wanted=wanted, volume=volume)
        command = [sys.executable, "-m", "softprint.runtime.authoring.fill_child", str(given), str(made)]
        try:
            done = subprocess.run(
                command,
                cwd=folder,  # where fTetWild leaves files of its own
                capture_output=True,
                text=True,
                errors="replace",
                timeout=_TIMEOUT,
                check=False,
                stdin=subprocess.DEVNULL,
            )
        except subprocess.TimeoutExpired:
            raise SoftprintError(
                f"{source}: filling it with tetrahedra took more than {_TIMEOUT / 60:.0f} minutes; ask for fewer "
                "--cells, or "
                "simplify the surface"
            ) from None
        if done.returncode or not made.is_file():
            lines = done.stderr.strip().splitlines() or ["no reason given"]
            why = f"ended by signal {-done.returncode}" if done.returncode < 0 else lines[-1]
            raise SoftprintError(f"{source}: fTetWild could not fill the surface with tetrahedra: {why}")
        with np.load(made, allow_pickle=False) as arrays:
            points, cells = arrays["points"], arrays["cells"].astype(np.int64)
            edge = float(arrays["edge"])
    if not len(cells):
        raise SoftprintError(
            f"{source}: nothing lies inside the surface: it does not enclose a volume, or its parts are too "
            "thin for so few --cells"
        )
    return Filled(points, cells, edge)
