"""The generalised contact force at a state: the derivative of the energy of contact along the handles."""

import numpy as np
import pytest

from softprint.runtime.colliders import Box, KeyframedPath, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, Simulator
from softprint.runtime.dynamics.handle_forces import HandleCoordinates, StaticContact
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.mechanics.body_mechanics import compute_mechanics

LAW = PenaltyContact(1e9, refinement=0)


def pressed(body):
    """A ball 6 mm deep in the top of the block, reached in two steps."""
    place = np.append(np.full(body.dim - 1, 0.004), 0.06 + 0.02)
    deep = [np.append(np.zeros(body.dim - 1), depth) for depth in (0.003, 0.006)]
    return Sphere(0.02, body.dim, "ball"), [{"ball": RigidPose(np.eye(body.dim), place - d)} for d in deep]


def test_without_mechanics_it_is_the_penalty_at_the_samples(jelly_body, dim):
    ball, way = pressed(jelly_body)
    static = StaticContact(jelly_body, [PlacedCollider("ball", ball)], LAW)
    rows, samples = jelly_body.rest_rows, jelly_body.surface
    basis = jelly_body.basis[samples.nodes]

    def energy(at):
        return LAW.energy(basis @ at, samples.areas, ball, way[-1]["ball"])

    force, direction = static.handle_force(rows, way), np.random.default_rng(0).normal(size=rows.shape)
    h = 1e-7
    slope = (energy(rows + h * direction) - energy(rows - h * direction)) / (2 * h)
    # Central differences over 1e-7 m of a cubic penalty a few millimetres deep.
    assert np.vdot(force, direction) == pytest.approx(slope, rel=1e-5)


def test_with_mechanics_it_balances_the_force_on_the_ball(jelly_body, dim):
    ball, way = pressed(jelly_body)
    mechanics = compute_mechanics(jelly_body, 400, condensation=False)
    static = StaticContact(jelly_body, [PlacedCollider("ball", ball)], LAW, mechanics)
    total = jelly_body.handles.affine_part @ static.handle_force(jelly_body.rest_rows, way)
    bare = StaticContact(jelly_body, [PlacedCollider("ball", ball)], LAW)
    rigid = jelly_body.handles.affine_part @ bare.handle_force(jelly_body.rest_rows, way)
    # The ball is pushed up, and less than by a surface that does not give way.
    assert 0.0 < total[-1] < 0.9 * rigid[-1]


def test_along_a_motion_it_is_the_force_of_each_step(jelly_body, dim):
    ball, (*_, deep) = pressed(jelly_body)
    mechanics = compute_mechanics(jelly_body, 400, condensation=False)
    above = RigidPose(np.eye(dim), deep["ball"].translation + np.append(np.zeros(dim - 1), 0.007))
    path = KeyframedPath([0.0, 0.2], [above.translation, deep["ball"].translation])
    held, placed = [KinematicHandle("base")], PlacedCollider("ball", ball, path)
    simulator = Simulator(jelly_body, [placed], contact=LAW, mechanics=mechanics, kinematic=held)
    results = [simulator.step(simulator.rest_state())]
    for _ in range(11):
        results.append(simulator.step(results[-1].state))
    states = [Configuration(result.state.rows, result.state.poses) for result in results]
    along = StaticContact(jelly_body, [placed], LAW, mechanics).along(states)
    forces = np.array([jelly_body.handles.affine_part @ h for h in along])
    expected = np.array([result.contacts["ball"].force for result in results])
    # Both balance contact to 1e-6 of its depth.
    np.testing.assert_allclose(forces, expected, atol=1e-4 * np.abs(expected).max())
    assert np.abs(expected).max() > 0.1
    assert not forces[0].any()


def test_sharp_points_press_where_the_collider_is(jelly_body, dim):
    """And not where it first touched: the force is that of a contact which is followed in steps."""
    law = PenaltyContact(1e9, refinement=1)
    mechanics = compute_mechanics(jelly_body, 400, condensation=False)
    box = Box(np.full(dim, 0.012), name="box")
    start = np.append(np.full(dim - 1, 0.004), 0.06 + 0.0125)
    ways = [start + s * np.append(np.full(dim - 1, 0.01), -0.004) for s in np.linspace(0.0, 1.0, 6)]
    poses = [RigidPose(np.eye(dim), at) for at in ways]
    static = StaticContact(jelly_body, [PlacedCollider("box", box)], law, mechanics)
    force = static.handle_force(jelly_body.rest_rows, [{"box": pose} for pose in poses])
    probe, near = ContactStateProbe(jelly_body, box, mechanics, law, 1e-3), None
    for pose in poses:
        near = probe.solve(jelly_body.rest_rows, pose, near)
    assert near.is_pressed.any()
    # The same solves: round-off. With the points of the first touch it is a tenth off.
    np.testing.assert_allclose(
        force, probe.evaluation(near).gradient, rtol=1e-9, atol=1e-9 * np.abs(force).max()
    )


def test_coordinates_of_held_frames_are_left_out(jelly_body, dim):
    rows = jelly_body.rest_rows
    gradient = np.random.default_rng(0).normal(size=rows.shape)
    frames = {frame.name for frame in jelly_body.handles.frames}
    free, every = HandleCoordinates(jelly_body, frames), HandleCoordinates(jelly_body, set())
    count = jelly_body.handles.n_points
    np.testing.assert_array_equal(free.along(rows, gradient), gradient[:count].ravel())
    along = every.along(rows, gradient)
    np.testing.assert_array_equal(along[: count * dim], gradient[:count].ravel())
    # The force on the origin of the frame, at rest about its pivot.
    np.testing.assert_allclose(along[count * dim : (count + 1) * dim], gradient[-1], rtol=1e-12)
