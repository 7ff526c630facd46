"""What two balls pressed into a body side by side feel of each other: pressed jointly, and each as if it were alone.

    softprint body examples/jelly3d_small.toml && python -m benchmarks.near_colliders runs/jelly3d_small/body.h5

Distances are in contact radii sqrt(R d) of a rigid ball of radius R pressed in by d. Positive: alone says too much.
"""

from __future__ import annotations

import argparse

import numpy as np

from runtime.body import load_body
from runtime.colliders import RigidPose, Sphere
from runtime.contact.condensed.contact_potential import ContactPotential
from runtime.contact.condensed.equilibrium import LoadProbe
from runtime.contact.condensed.potential_group import grouped
from runtime.mechanics.body_mechanics import compute_mechanics

RADIUS, DEPTH, STIFFNESS = 0.015, 0.003, 3e10  # m, m, N/m^4
APART = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # contact radii
LOADS = 3000


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("body", help="a body file, such as runs/jelly3d_small/body.h5")
    body = load_body(parser.parse_args().body)
    mechanics = compute_mechanics(body, LOADS, internal=True)
    balls = [Sphere(RADIUS, body.dim, name) for name in ("left", "right")]
    probes = {ball.name: LoadProbe(body, ball, mechanics, STIFFNESS) for ball in balls}
    (joint,) = grouped({name: ContactPotential(probe) for name, probe in probes.items()})
    rows, top = body.rest_rows, body.mesh.points[:, -1].max()
    print(f"{'apart':>6}{'energy':>10}{'force':>10}   of the sum of each alone, against both together")
    for apart in APART:
        half = 0.5 * apart * np.sqrt(RADIUS * DEPTH)
        poses = {
            name: RigidPose(
                np.eye(body.dim), np.r_[side * half, np.zeros(body.dim - 2), top + RADIUS - DEPTH]
            )
            for name, side in (("left", -1.0), ("right", 1.0))
        }
        energy, force = 0.0, 0.0
        for name, probe in probes.items():
            press = probe.press(rows, poses[name], rows)
            if press is not None:
                energy += press.solution.energy
                force -= press.solution.force[:, -1].sum()
        together = joint.pressed(rows, poses, rows).values()
        pushed = -sum(float(loads.pressure @ loads.normal[:, -1]) for loads in together)
        print(
            f"{apart:>6.1f}{energy / joint.energy(rows, poses, rows) - 1:>10.1%}{force / pushed - 1:>10.1%}"
        )


if __name__ == "__main__":
    main()
