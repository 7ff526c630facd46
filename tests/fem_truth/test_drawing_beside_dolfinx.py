"""Pictures with a scale are drawn in a process that has loaded DOLFINx, whose libraries clash with VTK's scalar bar."""

from __future__ import annotations

import subprocess
import sys

DRAW = """
import h5py, dolfinx
import numpy as np
from softprint.runtime.drawing.scene import Scene
from softprint.runtime.drawing.solid import draw_solid
from pathlib import Path

corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
facets = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
scene = Scene(title="a cell", points=corners, facets=facets, values=np.arange(4.0), label="height [m]")
draw_solid(Path("cell.png"), scene)
"""


def test_a_scale_is_drawn(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", DRAW], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "cell.png").read_bytes().startswith(b"\x89PNG")
