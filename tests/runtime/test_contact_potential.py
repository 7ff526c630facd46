"""The condensed energy of contact: derivatives by finite differences, resultants, and what steps make of it."""

from dataclasses import replace

import numpy as np
import pytest

from runtime.colliders import Placed, RigidPose, SmoothUnion, Sphere
from runtime.colliders.pose import rotation_matrix
from runtime.contact import PenaltyContact
from runtime.contact.condensed import contact_solve
from runtime.contact.condensed import equilibrium as load_press
from runtime.contact.condensed.condensed_contact import CondensedContact
from runtime.contact.condensed.contact_potential import ContactPotential
from runtime.contact.condensed.equilibrium import LoadProbe
from runtime.contact.condensed.potential_group import JointPotential, SinglePotential, grouped
from runtime.errors import SoftprintError
from runtime.mechanics.body_mechanics import compute_mechanics

STIFFNESS = 1e10  # N/m^4


def doubled(mechanics):
    """In float64, so that finite differences see the derivatives and not the rounding of what is kept."""
    internal = mechanics.internal
    if internal is None:
        return mechanics
    modes, weight = internal.modes.astype(np.float64), internal.weight.astype(np.float64)
    return mechanics._replace(internal=replace(internal, modes=modes, weight=weight))


@pytest.fixture(params=[False, True], ids=["bare", "internal"])
def pressed(jelly_body, dim, request):
    """A potential, rows of a strained body, the pose of a ball that is 6 mm deep in its top, and the body's turn."""
    ball = Sphere(0.02, dim, "ball")
    gravity = np.append(np.zeros(dim - 1), -9.81)
    mechanics = doubled(compute_mechanics(jelly_body, 400, request.param, gravity))
    probe = LoadProbe(jelly_body, ball, mechanics, STIFFNESS)
    rng = np.random.default_rng(5)
    rows = jelly_body.rest_rows + 1e-3 * rng.normal(size=jelly_body.rest_rows.shape)
    turned = [0.3] if dim == 2 else [0.3, -0.2, 0.5]
    pose = RigidPose.from_rotation_vector(turned, np.append(np.full(dim - 1, 0.004), 0.06 + 0.02 - 0.006))
    return ContactPotential(probe), rows, pose, rows


def test_second_derivatives_along_some_directions(pressed):
    potential, rows, pose, turn = pressed
    hessian = potential.linearise(rows, pose, turn)[2]
    along = np.random.default_rng(3).normal(size=(rows.size, 5))
    # The same products in another order, in the single precision of the compliance.
    expected = along.T @ hessian() @ along
    np.testing.assert_allclose(hessian(along), expected, atol=1e-5 * np.abs(expected).max())


def with_another(potential, body, mechanics):
    """Of the ball and of another one far away, which together press nothing else."""
    far = LoadProbe(body, Sphere(0.01, body.dim, "far"), mechanics, STIFFNESS, potential.probe._band)
    return JointPotential({"ball": potential, "far": ContactPotential(far)})


@pytest.mark.parametrize("joint", [False, True], ids=["alone", "with another"])
def test_loads_that_the_dent_pushes_in_are_found(jelly_body, dim, monkeypatch, joint):
    """Whichever loads it begins with, every one that would be inside the collider takes part in the end."""
    mechanics = compute_mechanics(jelly_body, 400, internal=False)
    place = np.append(np.full(dim - 1, 0.004), 0.06 + 0.02 - 0.006)
    poses = {"ball": RigidPose(np.eye(dim), place), "far": RigidPose(np.eye(dim), np.full(dim, 1.0))}
    rows = jelly_body.rest_rows

    def energy():
        probe = LoadProbe(jelly_body, Sphere(0.02, dim, "ball"), mechanics, STIFFNESS, 2e-3)
        potential = ContactPotential(probe)
        group = (
            with_another(potential, jelly_body, mechanics) if joint else SinglePotential("ball", potential)
        )
        return group.energy(rows, poses, rows)

    expected = energy()
    monkeypatch.setattr(load_press, "_ROOM", -0.4)  # begins with those deeper than that share of the deepest
    # Both are balanced to a millionth of the depth.
    assert energy() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("depth", [1e-13, 1e-15, 0.0])
def test_a_collider_that_only_just_touches(jelly_body, dim, depth):
    """No direction of its stiffening matters then, and there is nothing to factorise."""
    mechanics = compute_mechanics(jelly_body, 400, internal=False)
    probe = LoadProbe(jelly_body, Sphere(0.02, dim, "ball"), mechanics, STIFFNESS)
    nodes = jelly_body.mesh.points[probe.nodes]
    top = nodes[np.argmax(nodes[:, -1] - 1e-3 * np.linalg.norm(nodes[:, :-1], axis=1))]
    pose = RigidPose(np.eye(dim), top + np.append(np.zeros(dim - 1), 0.02 - depth))
    rows = jelly_body.rest_rows
    energy, gradient, hessian = ContactPotential(probe).linearise(rows, pose, rows)
    # k a d^3 / 3 is below 1e-30 J.
    assert 0.0 <= energy < 1e-30
    assert np.abs(gradient).max() < 1e-15
    if hessian is not None:
        assert np.isfinite(hessian()).all()


def test_what_presses_together_presses_alike(jelly_body, dim):
    mechanics = compute_mechanics(jelly_body, 50, internal=False)
    soft, stiff = (
        ContactPotential(LoadProbe(jelly_body, Sphere(0.02, dim, name), mechanics, stiffness))
        for name, stiffness in (("soft", STIFFNESS), ("stiff", 2.0 * STIFFNESS))
    )
    with pytest.raises(SoftprintError, match=r"'soft', 'stiff' press one body together.*give them the same"):
        grouped({"soft": soft, "stiff": stiff})


def test_derivatives(pressed, monkeypatch):
    # Differences over 1e-7 m see more of the loads' error than a step does.
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 1e-9)
    potential, rows, pose, turn = pressed
    energy, gradient, hessian = potential.linearise(rows, pose, turn)
    assert energy > 0
    rng = np.random.default_rng(0)
    for _ in range(3):
        way, h = rng.normal(size=rows.shape), 1e-7
        ahead, behind = rows + h * way, rows - h * way
        slope = (potential.energy(ahead, pose, turn) - potential.energy(behind, pose, turn)) / (2 * h)
        # Central differences over 1e-7 m of an energy solved to 1e-8 in displacement: a part in a million.
        assert slope == pytest.approx(np.vdot(gradient, way), rel=1e-5)
        change = (potential.linearise(ahead, pose, turn)[1] - potential.linearise(behind, pose, turn)[1]) / (
            2 * h
        )
        found = (hessian() @ way.ravel()).reshape(rows.shape)
        # Exact as well; the penalty's second derivative has a kink where a load starts to bear.
        assert np.abs(found - change).max() < 1e-4 * np.abs(change).max()


def test_force_and_derivatives_of_the_loads_agree(pressed):
    potential, rows, pose, turn = pressed
    press = potential.probe.press(rows, pose, turn)
    force = press.solution.force[press.bearing].ravel()
    # The same sums in another order.
    np.testing.assert_allclose(press.gradient.ravel(), -force @ press.carried, rtol=1e-10, atol=1e-12)


def test_what_moves_rigidly_is_known_before(jelly_body, dim):
    """The press of a state says of body and collider moved together what they come to: the same, turned."""
    mechanics = doubled(
        compute_mechanics(jelly_body, 400, True)
    )  # without gravity, which does not turn along
    probe = LoadProbe(jelly_body, Sphere(0.02, dim, "ball"), mechanics, STIFFNESS)
    rows = jelly_body.rest_rows + 1e-3 * np.random.default_rng(5).normal(size=jelly_body.rest_rows.shape)
    pose = RigidPose.from_rotation_vector(
        [0.3] if dim == 2 else [0.3, -0.2, 0.5], np.append(np.full(dim - 1, 0.004), 0.074)
    )
    press = probe.press(rows, pose, rows)
    Q = rotation_matrix([2.1] if dim == 2 else [1.1, 0.7, -1.6], dim)
    turned = RigidPose(Q @ pose.rotation, Q @ pose.translation)
    there = replace(
        press.problem,
        position=probe.loads.positions(rows @ Q.T, rows @ Q.T, press.index),
        F=probe.loads.deformation(rows @ Q.T, press.index),
    )
    left, normal = (found[press.bearing] for found in press.predict(press.index, there, turned))
    np.testing.assert_allclose(
        left, press.solution.left[press.bearing], rtol=1e-5
    )  # solved in single precision
    np.testing.assert_allclose(normal, press.solution.normal[press.bearing] @ Q.T, atol=1e-5)


def test_the_force_on_the_collider_is_the_slope_of_the_energy_along_its_path(pressed, dim):
    potential, rows, pose, turn = pressed
    contact = CondensedContact({"ball": potential})
    force = contact.forces(rows, {"ball": pose}, turn, None)[2]["ball"].force
    h = 1e-7
    for axis in np.eye(dim):
        moved = [RigidPose(pose.rotation, pose.translation + side * h * axis) for side in (1, -1)]
        slope = (potential.energy(rows, moved[0], turn) - potential.energy(rows, moved[1], turn)) / (2 * h)
        # Central differences over 1e-7 m, as above.
        assert -slope == pytest.approx(force @ axis, abs=1e-5 * np.linalg.norm(force))


def test_giving_way_costs_less_than_standing_firm(pressed, jelly_body):
    potential, rows, pose, turn = pressed
    probe = potential.probe
    rigid = PenaltyContact(STIFFNESS).energy(
        probe.loads.positions(rows, turn), probe._stiffness / STIFFNESS, probe.collider, pose
    )
    assert 0 < potential.energy(rows, pose, turn) < rigid


def test_nothing_out_of_contact(pressed):
    potential, rows, pose, turn = pressed
    away = RigidPose(pose.rotation, pose.translation + 0.02)
    energy, gradient, hessian = potential.linearise(rows, away, turn)
    assert energy == 0.0
    assert not gradient.any()
    assert hessian is None


def test_moving_body_and_collider_together_changes_nothing(jelly_body, dim):
    """Gravity, which does not move along, is left out."""
    mechanics = doubled(compute_mechanics(jelly_body, 400, internal=True))
    probe = LoadProbe(jelly_body, Sphere(0.02, dim, "ball"), mechanics, STIFFNESS)
    potential = ContactPotential(probe)
    rows = jelly_body.rest_rows + 1e-3 * np.random.default_rng(5).normal(size=jelly_body.rest_rows.shape)
    pose = RigidPose(np.eye(dim), np.append(np.full(dim - 1, 0.004), 0.074))
    motion = RigidPose.from_rotation_vector([0.7] if dim == 2 else [0.2, 0.7, -0.4], 0.1 * np.ones(dim))
    linear = np.ones(len(rows))
    linear[jelly_body.handles.n_points :] = np.tile(
        np.append(np.zeros(dim), 1.0), len(jelly_body.handles.frames)
    )
    moved = rows @ motion.rotation.T + linear[:, None] * motion.translation
    energy, gradient, _ = potential.linearise(rows, pose, rows)
    again, turned, _ = potential.linearise(moved, motion.compose(pose), moved)
    # The modes are rounded to float32, and so annihilate translations to 1e-7.
    assert again == pytest.approx(energy, rel=2e-6)
    assert np.abs(turned - gradient @ motion.rotation.T).max() < 2e-5 * np.abs(gradient).max()


def test_colliders_near_each_other_are_pressed_together(jelly_body, dim):
    """Two balls are one collider of two balls: energy, gradient and forces; alone, each would say something else."""
    mechanics = doubled(compute_mechanics(jelly_body, 400, internal=False))
    balls = [Sphere(0.015, dim, name) for name in ("left", "right", "away")]
    places = [np.append([x, 0.01][: dim - 1], z) for x, z in ((-0.017, 0.071), (0.017, 0.07), (0.0, 0.2))]
    poses = {ball.name: RigidPose(np.eye(dim), place) for ball, place in zip(balls, places, strict=True)}
    potentials = {
        ball.name: ContactPotential(LoadProbe(jelly_body, ball, mechanics, STIFFNESS)) for ball in balls
    }
    (joint,) = grouped(potentials)
    two = SmoothUnion([Placed(ball, poses[ball.name]) for ball in balls[:2]], 1e-9, "two")
    one = ContactPotential(LoadProbe(jelly_body, two, mechanics, STIFFNESS))
    rows, turn, at_rest = jelly_body.rest_rows, jelly_body.rest_rows, RigidPose.identity(dim)
    energy, gradient, hessian = joint.linearise(rows, poses, turn)
    expected = one.linearise(rows, at_rest, turn)
    # Balanced to 1e-6 of the depth each.
    assert energy == pytest.approx(expected[0], rel=1e-5)
    np.testing.assert_allclose(gradient, expected[1], atol=1e-5 * np.abs(gradient).max())
    stiffness = expected[2]()
    np.testing.assert_allclose(hessian(), stiffness, atol=1e-5 * np.abs(stiffness).max())
    pressed = joint.pressed(rows, poses, turn)
    assert len(pressed["away"].index) == 0
    together = sum(loads.pressure @ loads.normal for loads in pressed.values())
    alone = one.pressed(rows, at_rest, turn)
    np.testing.assert_allclose(together, alone.pressure @ alone.normal, atol=1e-5 * alone.pressure.sum())
    separately = sum(potential.energy(rows, poses[name], turn) for name, potential in potentials.items())
    assert abs(separately - energy) > 0.01 * energy


def test_what_shares_no_compliance_is_left_alone(jelly_body, dim):
    potentials = {
        name: ContactPotential(
            LoadProbe(
                jelly_body, Sphere(0.02, dim, name), compute_mechanics(jelly_body, 50, False), STIFFNESS
            )
        )
        for name in ("one", "other")
    }
    assert [type(group) for group in grouped(potentials)] == [SinglePotential] * 2
