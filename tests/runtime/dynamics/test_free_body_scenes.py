"""Scenes with free rigid bodies: momentum, weight, friction, energy, and no tunnelling."""

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, place_handles
from softprint.runtime.colliders import Box, KeyframedPath, Plane, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.elasticity import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh import box_mesh
from softprint.runtime.rigid import free_collider

CONTACT = PenaltyContact(1e10)
H, TOP = 0.01, 0.06
contacts = pytest.mark.parametrize("condensed", [False, True], ids=["penalty", "condensed"])


def down(dim, size=9.81):
    return np.append(np.zeros(dim - 1), -size)


def at(dim, *position, angle=0.0):
    return RigidPose.from_rotation_vector(
        [angle] if dim == 2 else [angle, 0.0, 0.0], [*position[: dim - 1], position[-1]]
    )


def placed(shape, pose, density=2000.0, **start):
    free = free_collider(shape, pose, density=density, **start)
    return PlacedCollider(shape.name, shape, free=free)


def block(body, colliders, friction=None, gravity=None, newton=None, step=H, mechanics=None):
    """A block fixed at its base."""
    return Simulator(
        body,
        colliders,
        contact=CONTACT,
        mechanics=mechanics,
        friction=friction,
        gravity=gravity,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(step, newton or NewtonSettings(60, 1e-6)),
    )


def moments(points, momenta):
    """sum x cross p, with one component in 2D and three in 3D."""
    return np.atleast_1d(np.cross(points, momenta).sum(axis=0))


def gained(simulator, before, after):
    """Linear and angular momentum that body and colliders together gain in a step, the angular one about their
    positions at its end: x_new x (p_new - p_old) + L_new - L_old. With backward Euler it is zero, and exactly the
    forces at the end of the step enter into it."""
    mass, basis = simulator.body.node_mass[:, None], simulator.body.basis
    p = mass * (basis @ (after.rows_velocity - before.rows_velocity))
    linear, angular = p.sum(axis=0), moments(basis @ after.rows, p)
    for placed in simulator.colliders:
        if placed.free is not None:
            old, new = before.motions[placed.name], after.motions[placed.name]
            p = placed.free.mass.mass * (new.velocity - old.velocity)
            centre = after.poses[placed.name].apply(placed.free.mass.centre[None])
            linear, angular = linear + p, angular + moments(centre, p[None]) + new.momentum - old.momentum
    return linear, angular


@contacts
def test_momentum_is_exchanged_between_bodies(dim, condensed):
    """A free body between two spinning colliders that approach it and collide, with friction and without gravity; with
    condensed contact, this includes their coupling through the body."""
    mesh = box_mesh([0.0] * dim, [0.06, 0.04, 0.04][:dim], [8, 6, 6][:dim])
    body = assemble_body(mesh, place_handles(mesh, 8), make_material("stable_neo_hookean", 2e4, 0.4), 1e3)
    spin = [20.0] if dim == 2 else [20.0, 5.0, -10.0]
    side = Sphere(0.02, dim, "side")
    # No corners with few contact nodes: a node that slips round a corner has an equilibrium on both sides of it.
    above = Sphere(0.015, dim, "above") if condensed else Box([0.02, 0.015, 0.015][:dim], name="above")
    late = Sphere(0.01, dim, "late")
    mechanics = compute_mechanics(body, 400, condensation=False) if condensed else None
    left, down_, fast = 0.6 * np.eye(dim)[0], -0.5 * np.eye(dim)[-1], -1.5 * np.eye(dim)[-1]
    colliders = [
        placed(side, at(dim, -0.021, 0.02, 0.02), velocity=left, spin=spin),
        placed(above, at(dim, 0.02, 0.02, 0.056, angle=0.2), velocity=down_, spin=spin),
        placed(late, at(dim, 0.02, 0.02, 0.1), velocity=fast),
    ]
    simulator = Simulator(
        body,
        colliders,
        contact=CONTACT,
        mechanics=mechanics,
        friction=CoulombFriction(0.5),
        settings=DynamicsSettings(H, NewtonSettings(100, 1e-8)),
    )
    state = simulator.rest_state()
    for _ in range(8):
        before, result = state, simulator.step(state)
        assert result.converged, result.reason
        state = result.state
        linear, angular = gained(simulator, before, state)
        # A residual of 1e-8 of forces of 10 N for 0.01 s; what is exchanged is of 0.01 to 0.1 kg m/s.
        np.testing.assert_allclose(linear, 0.0, atol=2e-9)
        np.testing.assert_allclose(angular, 0.0, atol=1e-10)
    lost = {
        c.name: np.linalg.norm(c.free.motion.velocity - state.motions[c.name].velocity) for c in colliders
    }
    assert min(lost.values()) > 0.1  # all of them had contact
    gained_spin = state.motions["side"].momentum - colliders[0].free.motion.momentum
    assert np.abs(gained_spin).max() > 1e-6  # by friction alone: it is a ball


def test_two_colliders_collide_in_free_space(dim, jelly_body):
    """Far from the body, with friction and spin."""
    spin = [30.0] if dim == 2 else [30.0, 0.0, 10.0]
    colliders = [
        placed(Sphere(0.02, dim, "ball"), at(dim, 1.0, 0.0, 0.0), velocity=0.5 * np.eye(dim)[0], spin=spin),
        placed(Box(np.full(dim, 0.02), name="box"), at(dim, 1.048, 0.005, 0.005, angle=0.1)),
    ]
    simulator = block(jelly_body, colliders, CoulombFriction(0.5), newton=NewtonSettings(60, 1e-7))
    state = simulator.rest_state()
    for _ in range(8):
        before, result = state, simulator.step(state)
        assert result.converged, result.reason
        state = result.state
        linear, angular = gained(simulator, before, state)
        # A residual of 1e-7 of forces of up to 100 N for 0.01 s, and half a metre of arm.
        np.testing.assert_allclose(linear, 0.0, atol=1e-7)
        np.testing.assert_allclose(angular, 0.0, atol=1e-7)
    assert np.linalg.norm(state.motions["box"].velocity) > 0.1


@pytest.fixture(scope="session")
def settled_balls(jelly2d_body, jelly3d_body):
    """A ball released just above the middle of the block, 1.2 s later: with both contact models, in 2D and 3D."""
    found = {}
    for body in (jelly2d_body, jelly3d_body):
        dim = body.dim
        ball = Sphere(0.03, dim, "ball")
        for condensed in (False, True):
            mechanics = compute_mechanics(body, 400, condensation=True) if condensed else None
            collider = placed(ball, at(dim, 0.0, 0.0, TOP + 0.03), 1500.0)
            # Static condensation is in single precision, which ends at residuals of 1e-6 and a little.
            newton = NewtonSettings(60, 1e-5)
            simulator = block(
                body, [collider], CoulombFriction(0.3), down(dim), newton, step=0.02, mechanics=mechanics
            )
            result = simulator.settle()
            energies, converged = [], True
            for _ in range(60):
                result = simulator.step(result.state)
                converged &= result.converged
                energies.append(sum(result.energies[k] for k in ("kinetic", "gravity", "elastic", "contact")))
            found[dim, condensed] = simulator, collider, result, np.array(energies), converged
    return found


@contacts
def test_a_ball_rests_by_its_weight(settled_balls, dim, condensed):
    simulator, collider, result, _, converged = settled_balls[dim, condensed]
    weight = 9.81 * collider.free.mass.mass
    assert converged
    # In the plane it still rolls to and fro on the few nodes under it, by 2 mm; in space it is right to 1e-4.
    assert result.contacts["ball"].force[-1] == pytest.approx(weight, rel=1e-2 if dim == 2 else 5e-4)
    # It rests where a static contact solve gives the same force.
    posed = PlacedCollider("ball", collider.collider)
    quasi = block(simulator.body, [posed], None, down(dim), mechanics=simulator.mechanics)
    pressed = quasi.settle(quasi.rest_state(poses={"ball": result.state.poses["ball"]}))
    assert pressed.converged
    assert pressed.contacts["ball"].force[-1] == pytest.approx(weight, rel=1e-2)


@contacts
def test_energy_only_decreases(settled_balls, dim, condensed):
    _, _, _, energies, _ = settled_balls[dim, condensed]
    lost = energies[0] - energies[-1]
    assert lost > 0
    # Backward Euler dissipates; where the energy is not convex (a ball on few nodes) or the body's rotations are
    # updated with the step, it may gain a little for a moment, and what friction displaces stores energy, too.
    assert np.diff(energies).max() < 0.03 * lost


@pytest.mark.parametrize(("slope", "slides"), [(0.2, False), (0.6, True)])
def test_a_box_on_an_incline(dim, jelly_body, slope, slides):
    """mu = 0.4: it stays below the cone's angle, and above it falls with g (sin - mu cos)."""
    g = 9.81 * (np.sin(slope) * np.eye(dim)[0] - np.cos(slope) * np.eye(dim)[-1])
    box = Box([0.02, 0.02, 0.01][-dim:], name="box")
    floor = PlacedCollider(
        "floor", Plane(np.eye(dim)[-1], "floor"), KeyframedPath([0.0], [at(dim, 0.0, 0.0, -0.5).translation])
    )
    colliders = [placed(box, at(dim, 1.0, 0.0, -0.49)), floor]
    simulator = Simulator(
        jelly_body,
        colliders,
        contact=CONTACT,
        friction=CoulombFriction(0.4, 1e-3),
        gravity=g,
        springs=[],
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(H, NewtonSettings(60, 1e-7)),
    )
    state = simulator.settle().state
    speeds = []
    for _ in range(25):
        state = simulator.step(state).state
        speeds.append(state.motions["box"].velocity[0])
    if slides:
        # After it has come to rest on its contact points; the lagged normal force differs a little from the current
        # one.
        assert (speeds[-1] - speeds[-11]) / (10 * H) == pytest.approx(
            9.81 * (np.sin(slope) - 0.4 * np.cos(slope)), rel=0.01
        )
    else:
        assert abs(speeds[-1]) < 1e-3  # sticking creeps below the slip velocity


def test_simulations_are_reproducible(dim, jelly_body):
    def fall():
        box = Box(np.full(dim, 0.012), name="box")
        simulator = block(
            jelly_body,
            [placed(box, at(dim, 0.0, 0.0, TOP + 0.02, angle=0.4))],
            CoulombFriction(0.3),
            down(dim),
        )
        state = simulator.settle().state
        for _ in range(12):
            state = simulator.step(state).state
        return state

    one, other = fall(), fall()
    np.testing.assert_array_equal(one.rows, other.rows)
    np.testing.assert_array_equal(one.poses["box"].matrix, other.poses["box"].matrix)


def test_there_is_no_tunnelling(dim, jelly_body):
    """A plate, 8 mm thick, falls 3 cm per step, onto a block of 6 cm and a ball in its path."""
    plate = Box([0.04, 0.04, 0.004][-dim:], name="plate")
    ball = Sphere(0.01, dim, "ball")
    colliders = [
        placed(plate, at(dim, 0.0, 0.0, 0.2), velocity=down(dim, 3.0)),
        placed(ball, at(dim, 0.03, 0.0, TOP + 0.05)),
    ]
    simulator = block(jelly_body, colliders, None, down(dim), NewtonSettings(100, 1e-4))
    state = simulator.settle().state
    for _ in range(10):
        result = simulator.step(state)
        # The ball is as small as the distance between nodes in 3D. Where the plate presses it in, the step says so.
        assert result.converged or result.piercing.collider == "ball", result.reason
        state = result.state
        surface = simulator.surface_positions(state)
        under = state.poses["plate"].apply_inverse(surface)
        above = under[np.abs(under[:, :-1]).max(axis=1) < 0.03, -1]
        assert above.max() < 0.0  # no part of the block below it is above its middle
        met = state.poses["plate"].apply_inverse(state.poses["ball"].translation[None])[0]
        assert met[-1] < 0.0 or np.abs(met[:-1]).max() > 0.04  # unless it has slipped out sideways
    assert state.poses["plate"].translation[-1] < TOP + 0.03  # it did arrive


@contacts
def test_a_box_that_a_body_pushes_feels_coulombs_force(dim, condensed, jelly_body):
    """A block pushes a box over a floor, with friction updated as often as by default. Normal forces between box and
    floor are far from the result in the first iterations of a step: friction must not keep those."""
    across, mu = np.eye(dim)[0], 0.4
    box = placed(Box(np.full(dim, 0.02), name="box"), at(dim, -0.035, 0.0, TOP + 0.0202))
    floor = PlacedCollider("floor", Plane(across, "floor"), KeyframedPath.constant(at(dim, -0.055, 0.0, 0.0)))
    way = np.outer([0.0, 0.04], np.eye(dim)[-1])
    simulator = Simulator(
        jelly_body,
        [box, floor],
        contact=PenaltyContact(1e12),
        mechanics=compute_mechanics(jelly_body, 400, condensation=True) if condensed else None,
        friction=CoulombFriction(mu, slip_velocity=2e-3),
        gravity=-9.81 * across,
        kinematic=[KinematicHandle("base", KeyframedPath([0.0, 0.4], way))],
        settings=DynamicsSettings(1 / 60, NewtonSettings(60)),
    )
    state, pushed = simulator.rest_state(), []
    for _ in range(24):
        result = simulator.step(state)
        assert result.converged, result.reason
        state = result.state
        pushed.append(result.contacts["box"].force)
    # On the floor the box bears its weight, less what the friction of the block lifts.
    force, weight = np.array(pushed), 9.81 * box.free.mass.mass
    limit = mu * (weight - force[:, 0])
    assert force[:, -1].max() < 3.0 * limit.max()  # at first it is set in motion, too
    # In the last 0.2 s the push varies by a hundredth, since the block still swings a little.
    np.testing.assert_allclose(force[12:, -1], limit[12:], rtol=0.03)


@contacts
def test_a_light_collider_falls_beside_a_heavy_body(jelly_body, dim, condensed):
    """By its own weight, however small beside that of the body, with the tolerance of a real scene."""
    gravity = down(dim)
    mechanics = compute_mechanics(jelly_body, 400, True, gravity) if condensed else None
    crumb = placed(Sphere(0.001, dim, "crumb"), at(dim, 0.0, 0.0, 0.3), density=100.0)
    weight = crumb.free.mass.mass * 9.81
    assert weight < 1e-3 * 9.81 * jelly_body.node_mass.sum()
    simulator = block(jelly_body, [crumb], None, gravity, NewtonSettings(20, 1e-4), mechanics=mechanics)
    state = simulator.settle(newton=NewtonSettings(60, 1e-6)).state
    for _ in range(10):
        result = simulator.step(state)
        assert result.converged
        state = result.state
    # Backward Euler: h^2 g (1 + 2 + ... + 10). A flight is quadratic: one iteration of Newton's method
    # solves it to round-off.
    fall = 0.3 - state.poses["crumb"].translation[-1]
    assert fall == pytest.approx(55 * H**2 * 9.81, rel=1e-12)
