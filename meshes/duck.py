"""Mesh the Duck, a rubber duck (thesis, figures 5.6 and 5.8). Needs gmsh.

    python meshes/duck.py --edge-length 0.0036 --inside 0.0075 --out meshes/duck_small.vtu
    python meshes/duck.py --edge-length 0.00193 --inside 0.0037 --out meshes/duck.vtu

It looks along x, its flat bottom is in z = 0, and it is symmetric in y. Lengths in metres.
"""

from __future__ import annotations

import numpy as np
from solid_mesh import mesh_from_command_line, smooth_maximum

from softprint.runtime.cli.script import run_script
from softprint.runtime.shapes.solid import Field, ball, blended, capsule, ellipsoid, moved, rotated

FILLET, BOTTOM_ROUNDING = 0.0016, 0.002


def duck() -> Field:
    body = moved(ellipsoid((0.040, 0.028, 0.024)), (0.0, 0.0, 0.020))
    breast = ball(0.021, (0.018, 0.0, 0.022))
    tail = capsule((-0.026, 0.0, 0.026), (-0.045, 0.0, 0.040), 0.012, 0.005)
    neck = capsule((0.020, 0.0, 0.034), (0.024, 0.0, 0.052), 0.014, 0.015)
    head = ball(0.020, (0.026, 0.0, 0.060))
    beak = moved(ellipsoid((0.012, 0.011, 0.0055)), (0.047, 0.0, 0.057))
    wings = [
        moved(rotated(ellipsoid((0.020, 0.007, 0.012)), 1, 0.3), (-0.006, side * 0.026, 0.025))
        for side in (-1.0, 1.0)
    ]
    whole = blended(FILLET, body, breast, tail, neck, head, beak, *wings)
    return lambda p: smooth_maximum(whole(p), -p[:, 2], BOTTOM_ROUNDING)


def main() -> None:
    lower, upper = np.array([-0.054, -0.038, -0.003]), np.array([0.063, 0.038, 0.083])
    mesh_from_command_line((__doc__ or "").splitlines()[0], duck(), lower, upper, spacing=0.0008)


if __name__ == "__main__":
    run_script(main)
