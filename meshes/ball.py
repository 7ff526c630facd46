"""Mesh the Ball, a massage ball with 42 blunt spikes. Needs gmsh.

    python meshes/ball.py --edge-length 0.0040 --inside 0.0080 --out meshes/ball_small.vtu
    python meshes/ball.py --edge-length 0.0025 --inside 0.0045 --out meshes/ball.vtu

Centred at the origin. Lengths in metres.
"""

from __future__ import annotations

import numpy as np
from solid_mesh import mesh_from_command_line

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.shapes.solid import Field, ball, blended, capsule

RADIUS, REACH = 0.034, 0.046  # of the ball, and of its spikes
SPIKE_FOOT, SPIKE_TIP = 0.0056, 0.0036  # radii of a spike
FILLET = 0.0008
FINER = 0.7  # edges on the spikes, in those between them


def directions() -> Array:
    """(42, 3) unit vectors: the corners of an icosahedron and the middles of its edges."""
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    flat = np.array([(0.0, a, b * golden) for a in (1, -1) for b in (1, -1)])
    corners = np.vstack([np.roll(flat, turn, axis=1) for turn in range(3)])
    first, second = np.triu_indices(12, 1)
    edge = np.isclose(np.linalg.norm(corners[first] - corners[second], axis=1), 2.0)
    middles = corners[first[edge]] + corners[second[edge]]
    return np.vstack([v / np.linalg.norm(v, axis=1, keepdims=True) for v in (corners, middles)])


def spiky_ball() -> Field:
    spikes = [capsule(0.9 * RADIUS * d, (REACH - SPIKE_TIP) * d, SPIKE_FOOT, SPIKE_TIP) for d in directions()]
    return blended(FILLET, ball(RADIUS), *spikes)


def finer_at_tips(point: Array) -> float:
    share = np.clip((np.linalg.norm(point) - RADIUS) / (REACH - SPIKE_TIP - RADIUS), 0.0, 1.0)
    return float(1.0 - share * (1.0 - FINER))


def main() -> None:
    box, line = np.full(3, REACH + 0.004), (__doc__ or "").splitlines()[0]
    mesh_from_command_line(line, spiky_ball(), -box, box, spacing=0.001, share=finer_at_tips)


if __name__ == "__main__":
    run_script(main)
