"""What is drawn with mechanics alone: the dent of contact, with no correction on the colliders."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics

TOP, RADIUS = 0.06, 0.02  # m
NAMES = ("left", "right")


def poses_of(dim, depth):
    places = np.array([-0.025, 0.025])
    return {
        name: RigidPose(np.eye(dim), np.append(np.eye(dim - 1)[0] * along, TOP + RADIUS - depth))
        for name, along in zip(NAMES, places, strict=True)
    }


@pytest.mark.parametrize("refinement", [0, 1], ids=["at nodes", "on facets"])
def test_a_dent_is_drawn_as_with_a_correction_that_has_learned_nothing(jelly_body, dim, refinement) -> None:
    mechanics = compute_mechanics(jelly_body, 400, True)
    law = PenaltyContact(3e11, refinement)
    options = ForceModelOptions((4,), "silu", 5e-4, 5e-3, law.stiffness, refinement=refinement)
    drawn = []
    for corrected in ((), NAMES[:1], NAMES):
        placed = []
        for name in NAMES:
            shape = Sphere(RADIUS, dim, name)
            untrained = ForceModel(options, dim, jelly_body.n_rows)
            correction = (
                ForceCorrection("untrained", untrained, jelly_body, shape, mechanics)
                if name in corrected
                else None
            )
            placed.append(PlacedCollider(name, shape, correction=correction))
        simulator = Simulator(
            jelly_body,
            placed,
            contact=law,
            mechanics=mechanics,
            friction=CoulombFriction(0.4),
            kinematic=[KinematicHandle("base")],
        )
        state = simulator.rest_state(poses=poses_of(dim, 0.0))
        for step in range(1, 4):
            state = simulator.step(state, poses_of(dim, 2e-3 * step)).state
        drawn.append(simulator.positions(state))
        follow = simulator.follow(jelly_body.mesh.surface_nodes)
        # The compliance is in single precision, and is summed in another order.
        np.testing.assert_allclose(follow(state), drawn[-1][jelly_body.mesh.surface_nodes], atol=1e-8)
    for other in drawn[1:]:
        np.testing.assert_allclose(other, drawn[0], atol=1e-8)
    # The balls press 6 mm deep; facets of 7 to 20 mm hide some of it.
    top = jelly_body.mesh.points[:, -1] > TOP - 1e-9
    assert TOP - drawn[0][top, -1].min() > 2e-3
