"""What two balls pressed into a body side by side feel of each other: solved together, and each as if it were alone.

    softprint body examples/jelly3d_small.toml && python -m reproduction.near_colliders runs/jelly3d_small/body.h5

Distances are in contact radii sqrt(R d) of a rigid ball of radius R pressed in by d. Positive: the sum of both alone is
too large.
"""

from __future__ import annotations

import argparse

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body import load_body
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics

RADIUS, DEPTH, STIFFNESS = 0.015, 0.003, 3e10  # m, m, N/m^4
APART = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # contact radii
CONTACT_NODES = 3000
SIDES = {"left": -1.0, "right": 1.0}


def contact_with(body: ReducedBody, mechanics: BodyMechanics, *names: str) -> CondensedContact:
    """Of the body with some of the balls."""
    balls = {name: Sphere(RADIUS, body.dim, name) for name in names}
    return CondensedContact.of(body, mechanics, balls, PenaltyContact(STIFFNESS))


def energy_and_force(contact: CondensedContact, rows: Array, poses: Poses) -> tuple[float, float]:
    """W [J] and the force upwards [N] on all colliders of a contact."""
    found = contact.evaluate(contact.in_frame(rows), rows, poses, None)
    return found.energy, sum(float(force.force[-1]) for force in found.forces().values())


def main() -> None:
    """Print a line for each distance."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("body", help="a body file, such as runs/jelly3d_small/body.h5")
    body = load_body(parser.parse_args().body)
    mechanics = compute_mechanics(body, CONTACT_NODES, condensation=True)
    alone = {name: contact_with(body, mechanics, name) for name in SIDES}
    together = contact_with(body, mechanics, *SIDES)
    rows, top = body.rest_rows, body.mesh.points[:, -1].max()
    print(f"{'apart':>6}{'energy':>10}{'force':>10}   of the sum of each alone, against both together")
    for apart in APART:
        half = 0.5 * apart * np.sqrt(RADIUS * DEPTH)
        poses = {
            name: RigidPose(
                np.eye(body.dim), np.r_[side * half, np.zeros(body.dim - 2), top + RADIUS - DEPTH]
            )
            for name, side in SIDES.items()
        }
        each = [energy_and_force(contact, rows, {name: poses[name]}) for name, contact in alone.items()]
        energy, force = np.sum(each, axis=0)
        joint_energy, joint_force = energy_and_force(together, rows, poses)
        print(f"{apart:>6.1f}{energy / joint_energy - 1:>10.1%}{force / joint_force - 1:>10.1%}")


if __name__ == "__main__":
    run_script(main)
