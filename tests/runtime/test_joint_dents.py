"""What several colliders near each other do to a body, as it is drawn: the dents that they press together."""

from __future__ import annotations

import numpy as np

from runtime.colliders import KeyframedPath, Placed, RigidPose, SmoothUnion, Sphere
from runtime.contact import PenaltyContact
from runtime.dynamics.placed_collider import PlacedCollider
from runtime.dynamics.simulator import Simulator
from runtime.learned.force.correction import ForceCorrection
from runtime.learned.force.model import ForceModel, ForceModelOptions
from runtime.mechanics.body_mechanics import compute_mechanics

STIFFNESS = 1e10  # N/m^4
OPTIONS = ForceModelOptions((4, 4), "silu", 5e-4, 3e-3, STIFFNESS)


def simulator_of(body, mechanics, placed) -> Simulator:
    """With untrained corrections, whose dents are those of mechanics, on colliders held at poses."""
    model = ForceModel(OPTIONS, body.dim, body.n_rows).double()
    colliders = [
        PlacedCollider(
            shape.name,
            shape,
            KeyframedPath([0.0], [pose.translation]),
            correction=ForceCorrection("x", model, body, shape, mechanics),
        )
        for shape, pose in placed
    ]
    return Simulator(body, colliders, contact=PenaltyContact(STIFFNESS))


def test_dents_near_each_other_are_drawn_as_of_one_collider(jelly_body, dim):
    mechanics = compute_mechanics(jelly_body, 400, internal=False)
    balls = [Sphere(0.015, dim, name) for name in ("left", "right")]
    places = [np.append([x, 0.01][: dim - 1], z) for x, z in ((-0.017, 0.071), (0.017, 0.07))]
    poses = [RigidPose(np.eye(dim), place) for place in places]
    two = SmoothUnion([Placed(ball, pose) for ball, pose in zip(balls, poses, strict=True)], 1e-9, "two")
    scenes = {
        "together": [*zip(balls, poses, strict=True)],
        "union": [(two, RigidPose.identity(dim))],
        "left": [(balls[0], poses[0])],
        "right": [(balls[1], poses[1])],
    }
    rest, moved = jelly_body.mesh.points, {}
    for name, placed in scenes.items():
        simulator = simulator_of(jelly_body, mechanics, placed)
        state = simulator.rest_state()
        moved[name] = simulator.positions(state) - rest
        nodes = jelly_body.surface.nodes
        # The same loads, summed at fewer nodes.
        np.testing.assert_allclose(
            simulator.surface_positions(state) - rest[nodes], moved[name][nodes], atol=1e-12
        )
    largest = np.abs(moved["union"]).max()
    # Both are balanced to 1e-6 of the depth.
    np.testing.assert_allclose(moved["together"], moved["union"], atol=1e-5 * largest)
    # Each on its own would go in as if the other were not there.
    assert np.abs(moved["left"] + moved["right"] - moved["union"]).max() > 0.02 * largest
