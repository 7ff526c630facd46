"""The judge of random scenes (`benchmarks/random_scenes.py`)."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.random_scenes import deepest_inside
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.mechanics.body_mechanics import compute_mechanics


@pytest.mark.parametrize("with_mechanics", [False, True], ids=["bare", "mechanics"])
def test_the_depth_in_all_cells_is_that_of_the_contact_law(jelly3d_body, with_mechanics):
    """A ball that rests in its dent is as deep inside the body as the contact law says, and far less deep than it was
    led in: the dent counts once. Facets are flat between their points, which is part of what they differ by."""
    body = jelly3d_body
    mechanics = compute_mechanics(body, 200, True) if with_mechanics else None
    ball = Sphere(0.02, 3, "ball")
    simulator = Simulator(
        body,
        [PlacedCollider("ball", ball)],
        contact=PenaltyContact(1e9, 1),
        mechanics=mechanics,
        kinematic=[KinematicHandle(frame.name) for frame in body.handles.frames[:1]],
    )
    led_in = 0.006
    at = np.append(np.zeros(2), body.mesh.points[:, 2].max() + 0.02 - led_in)
    state = simulator.rest_state(poses={"ball": RigidPose(np.eye(3), at)})
    settled = simulator.settle(state)
    assert settled.converged
    depth, penetration = deepest_inside(simulator, settled.state), settled.contacts["ball"].penetration
    assert 0.1 * led_in < penetration < 0.7 * led_in
    assert depth == pytest.approx(penetration, rel=0.3)
    away = simulator.settle(
        simulator.rest_state(poses={"ball": RigidPose(np.eye(3), at + np.array([0.0, 0.0, 0.01]))})
    )
    assert deepest_inside(simulator, away.state) == 0.0
