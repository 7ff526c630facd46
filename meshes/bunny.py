"""Mesh the Bunny, a soft layer on a rigid core (thesis, figure 4.11). Needs gmsh.

    python meshes/bunny.py --edge-length 0.0050 --inside 0.0090 --out meshes/bunny_small.vtu
    python meshes/bunny.py --edge-length 0.0036 --inside 0.0061 --out meshes/bunny.vtu

It sits on z = 0 and looks along x: a body, a head, two ears and a tail. Lengths in metres. `CORE` says where its core
is, segments and their radius, which the examples make one rigid frame of.
"""

from __future__ import annotations

import numpy as np
from solid_mesh import mesh_from_command_line, smooth_maximum

from softprint.runtime.cli.script import run_script
from softprint.runtime.shapes.solid import Field, ball, blended, capsule, ellipsoid, moved

FILLET, BOTTOM_ROUNDING = 0.0025, 0.003
CORE = (((0.0, 0.0, 0.026), (0.0, 0.0, 0.050)), ((0.010, 0.0, 0.072), (0.012, 0.0, 0.090)))


def bunny() -> Field:
    body = moved(ellipsoid((0.037, 0.034, 0.042)), (0.0, 0.0, 0.036))
    head = moved(ellipsoid((0.030, 0.028, 0.029)), (0.011, 0.0, 0.082))
    ears = [
        capsule((0.006, side * 0.014, 0.098), (-0.004, side * 0.026, 0.142), 0.0095, 0.0075)
        for side in (-1.0, 1.0)
    ]
    feet = [
        capsule((0.012, side * 0.022, 0.010), (0.042, side * 0.024, 0.010), 0.013, 0.011)
        for side in (-1.0, 1.0)
    ]
    tail = ball(0.013, (-0.040, 0.0, 0.022))
    whole = blended(FILLET, body, head, *ears, *feet, tail)
    return lambda p: smooth_maximum(whole(p), -p[:, 2], BOTTOM_ROUNDING)


def main() -> None:
    lower, upper = np.array([-0.058, -0.042, -0.004]), np.array([0.060, 0.042, 0.156])
    mesh_from_command_line((__doc__ or "").splitlines()[0], bunny(), lower, upper, spacing=0.0012)


if __name__ == "__main__":
    run_script(main)
