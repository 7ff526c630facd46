"""Scenes with colliders that move freely: momentum, weight, friction, energy, and that nothing is passed through."""

from dataclasses import dataclass

import numpy as np
import pytest

from runtime.body import assemble_body, place_handles
from runtime.colliders import Box, KeyframedPath, Plane, RigidPose, Sphere
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.contact.condensed.contact_potential import ContactPotential
from runtime.contact.condensed.equilibrium import LoadProbe
from runtime.dynamics import DynamicsSettings, KinematicHandle, NewtonSettings, PlacedCollider, Simulator
from runtime.elasticity import make_material
from runtime.mechanics.body_mechanics import compute_mechanics
from runtime.mechanics.static_condensation import StaticCondensation
from runtime.mesh import box_mesh
from runtime.rigid import free_collider

CONTACT = PenaltyContact(1e10)
H, TOP = 0.01, 0.06


@dataclass(frozen=True, eq=False)
class PotentialAlone:
    """A correction of which nobody asks the field."""

    collider: str
    potential: ContactPotential
    internal: StaticCondensation | None
    name, support = "potential", np.inf


def down(dim, size=9.81):
    return np.append(np.zeros(dim - 1), -size)


def at(dim, *position, turn=0.0):
    return RigidPose.from_rotation_vector(
        [turn] if dim == 2 else [turn, 0.0, 0.0], [*position[: dim - 1], position[-1]]
    )


def placed(shape, pose, density=2000.0, correction=None, **start):
    free = free_collider(shape, pose, density=density, **start)
    return PlacedCollider(shape.name, shape, None, correction, free)


def block(body, colliders, friction=None, gravity=None, newton=None, step=H):
    """Held by its base."""
    return Simulator(
        body,
        colliders,
        contact=CONTACT,
        friction=friction,
        gravity=gravity,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(step, newton or NewtonSettings(60, 1e-6)),
    )


def moments(points, momenta):
    """sum x cross p, with one component in 2D and three in 3D."""
    return np.atleast_1d(np.cross(points, momenta).sum(axis=0))


def gained(simulator, before, after):
    """Linear and angular momentum that body and colliders together gain in a step, the angular about where they are at
    its end: x_new x (p_new - p_old) + L_new - L_old. Backward Euler keeps that at zero, and exactly the forces of the
    end of the step enter into it."""
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


@pytest.mark.parametrize("ours", [False, True], ids=["bare", "ours"])
def test_momentum_goes_from_one_to_the_other(dim, ours):
    """A free body between two spinning colliders that close in on it and meet, with friction and without gravity; of
    ours, all that they press with each other through the body takes part."""
    mesh = box_mesh([0.0] * dim, [0.06, 0.04, 0.04][:dim], [8, 6, 6][:dim])
    body = assemble_body(mesh, place_handles(mesh, 8), make_material("stable_neo_hookean", 2e4, 0.4), 1e3)
    spin = [20.0] if dim == 2 else [20.0, 5.0, -10.0]
    side = Sphere(0.02, dim, "side")
    # No corners where loads are few: one that slips round a corner is in balance before it and behind it.
    above = Sphere(0.015, dim, "above") if ours else Box([0.02, 0.015, 0.015][:dim], name="above")
    late = Sphere(0.01, dim, "late")
    correct = dict.fromkeys((side, above, late))
    if ours:
        mechanics = compute_mechanics(body, 400, internal=False)
        correct = {
            shape: PotentialAlone(
                shape.name, ContactPotential(LoadProbe(body, shape, mechanics, CONTACT.stiffness)), None
            )
            for shape in correct
        }
    left, down_, fast = 0.6 * np.eye(dim)[0], -0.5 * np.eye(dim)[-1], -1.5 * np.eye(dim)[-1]
    colliders = [
        placed(side, at(dim, -0.021, 0.02, 0.02), correction=correct[side], velocity=left, spin=spin),
        placed(
            above, at(dim, 0.02, 0.02, 0.056, turn=0.2), correction=correct[above], velocity=down_, spin=spin
        ),
        placed(late, at(dim, 0.02, 0.02, 0.1), correction=correct[late], velocity=fast),
    ]
    simulator = Simulator(
        body,
        colliders,
        contact=CONTACT,
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
    assert min(lost.values()) > 0.1  # all of them met something
    turned = state.motions["side"].momentum - colliders[0].free.motion.momentum
    assert np.abs(turned).max() > 1e-6  # by friction alone: it is a ball


def test_two_colliders_meet_in_free_space(dim, jelly_body):
    """Far from the body, with friction and spin."""
    spin = [30.0] if dim == 2 else [30.0, 0.0, 10.0]
    colliders = [
        placed(Sphere(0.02, dim, "ball"), at(dim, 1.0, 0.0, 0.0), velocity=0.5 * np.eye(dim)[0], spin=spin),
        placed(Box(np.full(dim, 0.02), name="box"), at(dim, 1.048, 0.005, 0.005, turn=0.1)),
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
    """A ball let go just above the middle of the block, 1.2 s later: bare and ours, in 2D and 3D."""
    found = {}
    for body in (jelly2d_body, jelly3d_body):
        dim = body.dim
        ball = Sphere(0.03, dim, "ball")
        for ours in (False, True):
            correction = None
            if ours:
                mechanics = compute_mechanics(body, 400, True, down(dim))
                probe = LoadProbe(body, ball, mechanics, CONTACT.stiffness)
                correction = PotentialAlone("ball", ContactPotential(probe), mechanics.internal)
            collider = placed(ball, at(dim, 0.0, 0.0, TOP + 0.03), 1500.0, correction)
            # The internal response is in single precision, which ends at residuals of 1e-6 and a little.
            simulator = block(
                body, [collider], CoulombFriction(0.3), down(dim), NewtonSettings(60, 1e-5), step=0.02
            )
            result = simulator.settle()
            energies, converged = [], True
            for _ in range(60):
                result = simulator.step(result.state)
                converged &= result.converged
                energies.append(sum(result.energies[k] for k in ("kinetic", "gravity", "elastic", "contact")))
            found[dim, ours] = simulator, collider, result, np.array(energies), converged
    return found


@pytest.mark.parametrize("ours", [False, True], ids=["bare", "ours"])
def test_a_ball_rests_by_its_weight(settled_balls, dim, ours):
    simulator, collider, result, _, converged = settled_balls[dim, ours]
    weight = 9.81 * collider.free.mass.mass
    assert converged
    # In the plane it still rolls to and fro on the few nodes under it, by 2 mm; in space it is right to 1e-4.
    assert result.contacts["ball"].force[-1] == pytest.approx(weight, rel=1e-2 if dim == 2 else 5e-4)
    # And it rests where pressing it there slowly takes the same force, without any dynamics.
    posed = PlacedCollider("ball", collider.collider, None, collider.correction)
    quasi = block(simulator.body, [posed], None, down(dim))
    pressed = quasi.settle(quasi.rest_state(poses={"ball": result.state.poses["ball"]}))
    assert pressed.converged
    assert pressed.contacts["ball"].force[-1] == pytest.approx(weight, rel=1e-2)


@pytest.mark.parametrize("ours", [False, True], ids=["bare", "ours"])
def test_energy_only_falls(settled_balls, dim, ours):
    _, _, _, energies, _ = settled_balls[dim, ours]
    lost = energies[0] - energies[-1]
    assert lost > 0
    # Backward Euler dissipates; where force is not convex (a ball on few nodes) or the body's turn is taken anew with
    # the step, it may gain a little for a moment.
    assert np.diff(energies).max() < 0.02 * lost


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
        # From when it has settled on its points; the normal force of the step before is not quite that of this one.
        assert (speeds[-1] - speeds[-11]) / (10 * H) == pytest.approx(
            9.81 * (np.sin(slope) - 0.4 * np.cos(slope)), rel=0.01
        )
    else:
        assert abs(speeds[-1]) < 1e-3  # sticking creeps below the slip velocity


def test_the_same_again_is_the_same(dim, jelly_body):
    def fall():
        box = Box(np.full(dim, 0.012), name="box")
        simulator = block(
            jelly_body,
            [placed(box, at(dim, 0.0, 0.0, TOP + 0.02, turn=0.4))],
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


def test_nothing_is_passed_through(dim, jelly_body):
    """A plate, 8 mm thick, falls 3 cm in each step, on a block of 6 cm and on a ball on its way."""
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
        assert result.converged, result.reason
        state = result.state
        surface = simulator.surface_positions(state)
        under = state.poses["plate"].apply_inverse(surface)
        above = under[np.abs(under[:, :-1]).max(axis=1) < 0.03, -1]
        assert above.max() < 0.0  # no part of the block that it covers is above its middle
        met = state.poses["plate"].apply_inverse(state.poses["ball"].translation[None])[0]
        assert met[-1] < 0.0 or np.abs(met[:-1]).max() > 0.04  # unless it has slipped out sideways
    assert state.poses["plate"].translation[-1] < TOP + 0.03  # it did arrive
