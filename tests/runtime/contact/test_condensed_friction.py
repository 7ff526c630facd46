"""Friction of condensed contact: derivatives, Coulomb's law, and a ball dragged over the top of a held block."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.condensed_friction import CondensedFriction
from softprint.runtime.contact.lagged_friction import SlipStart
from softprint.runtime.contact.solver import contact_solve
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.dynamics.step import held_hardening
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.optimise.status import Status

STIFFNESS = 1e10  # N/m^4
TIME_STEP = 0.01
TOP = 0.06  # m, of the block
RADIUS = 0.06
DEPTH, STRIDE = 0.005, 5e-4


@pytest.fixture(params=[False, True], ids=["subspace", "condensation"])
def mechanics(jelly_body, request):
    """In float64, so that finite differences see the derivatives and not the rounding of what is kept."""
    found = compute_mechanics(jelly_body, 400, request.param)
    condensation = found.condensation
    if condensation is None:
        return found
    modes, weight = condensation.modes.astype(np.float64), condensation.weight.astype(np.float64)
    return found._replace(condensation=replace(condensation, modes=modes, weight=weight))


def ball_at(dim, depth, along=0.0):
    """The pose of a ball so deep in the middle of the top, moved along the first axis."""
    return RigidPose(np.eye(dim), np.append(np.eye(dim - 1)[0] * along, TOP + RADIUS - depth))


@pytest.fixture(
    params=[(0, 1), (4, 1), (4, 2), (1, 1)],
    ids=["at nodes", "on facets", "two along a facet", "and of sharp points"],
)
def law(request):
    """Contact at nodes, at the centres of facets, and at several points of every facet."""
    return PenaltyContact(STIFFNESS, *request.param)


@pytest.fixture(params=[0, 1], ids=["at nodes", "on facets"])
def few(request):
    """Contact at as few points as a facet allows, for motions."""
    return PenaltyContact(STIFFNESS, request.param)


def contact_with_ball(body, mechanics, law):
    return CondensedContact.of(body, mechanics, {"ball": Sphere(RADIUS, body.dim, "ball")}, law)


def block(body, mechanics, friction, law, **settings):
    """Held by its base, under a ball that the caller places."""
    return Simulator(
        body,
        [PlacedCollider("ball", Sphere(RADIUS, body.dim, "ball"))],
        contact=law,
        friction=friction,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(TIME_STEP, **settings),
        mechanics=mechanics,
    )


def strained(body, seed=5):
    rng = np.random.default_rng(seed)
    return body.rest_rows + 1e-3 * rng.normal(size=body.rest_rows.shape)


def lag_at(body, mechanics, law, begin, end, start_rows, rows):
    """The contact with the ball at the end of a step, at handle rows and a pose, in the frame of the body at rest; and
    the nodes that slide in it, their slip measured from the contact where the step began."""
    contact = contact_with_ball(body, mechanics, law)
    points = contact.in_frame(body.rest_rows)
    before = contact.evaluate(points, start_rows, {"ball": begin}, None)
    after = contact.evaluate(points, rows, {"ball": end}, before.warm_start)
    nothing = np.empty((0, body.dim))
    slip = SlipStart(nothing, {"ball": begin}, TIME_STEP, before.deformed_positions, lambda: nothing)
    return after, slip


def test_derivatives_of_the_energy_of_a_step(jelly_body, dim, mechanics, law, monkeypatch):
    """The friction is that of a ball that has moved on by 1 mm; eps = slip_velocity h is 1 mm as well."""
    caught = []

    def catch(*arguments):
        caught.extend(arguments)
        raise StopIteration

    monkeypatch.setattr(held_hardening, "solve_step", catch)
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 1e-12)  # differences over 1e-7 m see what is left
    simulator = block(jelly_body, mechanics, CoulombFriction(0.4, slip_velocity=0.1), law)
    state = simulator.rest_state(poses={"ball": ball_at(dim, 0.004)})
    with pytest.raises(StopIteration):
        simulator.step(state, poses={"ball": ball_at(dim, 0.005, 0.001)})
    problem, point, _, sliding = caught
    rng = np.random.default_rng(dim)
    begin = problem.point(point.body.near(Configuration(state.rows, point.body.at.poses)))
    x = problem.retract(begin, 1e-3 * rng.normal(size=jelly_body.handles.n_points * dim))
    problem = replace(problem, lagged=problem.lag(x, sliding.slip))
    x = problem.point(x.body)
    at = problem.linearise(x)
    contact, friction, _ = x.contacts()
    assert contact > 0
    assert friction > 0
    assert at.energy == pytest.approx(problem.energy(x), rel=1e-12)  # the same sums in another order
    for _ in range(4):
        direction, h = rng.normal(size=len(at.gradient)), 1e-7
        ahead, behind = problem.retract(x, h * direction), problem.retract(x, -h * direction)
        slope = (problem.energy(ahead) - problem.energy(behind)) / (2 * h)
        # Central differences over 1e-7 m: a part in a million.
        assert slope == pytest.approx(at.gradient @ direction, rel=1e-5, abs=1e-6 * at.scale)
        # Only points are free, so that gradients at different rows are in the same coordinates.
        change = (problem.linearise(ahead).gradient - problem.linearise(behind).gradient) / (2 * h)
        # The second derivative of penalty has a kink where a node begins to bear pressure.
        assert np.abs(at.hessian @ direction - change).max() < 1e-4 * np.abs(change).max()


@pytest.mark.parametrize("slip_velocity", [0.01, 1.0], ids=["slips", "sticks"])
def test_friction_alone_has_exact_derivatives(jelly_body, dim, mechanics, law, slip_velocity):
    """eps = slip_velocity h is 0.1 mm and 10 mm, for a ball that moved on by 1 mm."""
    rows, friction = strained(jelly_body), CondensedFriction(CoulombFriction(0.4, slip_velocity))
    poses = {"ball": ball_at(dim, 0.006, 0.001)}
    after, slip = lag_at(
        jelly_body, mechanics, law, ball_at(dim, 0.005), poses["ball"], jelly_body.rest_rows, rows
    )
    sliding = friction.lag(after, poses, slip)
    direction, h = np.random.default_rng(0).normal(size=rows.shape), 1e-7

    def differentiated(at):
        found = friction.evaluate(sliding, at, poses, TIME_STEP)
        return found.energy, *found.linearise({})[:2]

    at, ahead, behind = (differentiated(rows + side * h * direction) for side in (0, 1, -1))
    # No solve inside: round-off of 1e-16 of the energy over 1e-7 of a feature of 1e-3 m.
    assert (ahead[0] - behind[0]) / (2 * h) == pytest.approx(np.vdot(at[1], direction), rel=1e-6)
    change = (ahead[1] - behind[1]) / (2 * h)
    # In 2D what slips has no stiffness: what is left is round-off of a force over 1e-7 m.
    round_off = 1e-15 * np.abs(at[1]).max() / h
    found = (at[2] @ direction.ravel()).reshape(rows.shape)
    # The slope of the second derivative jumps where a point begins to slip: an error of h / eps = 1e-3 at one of many.
    assert np.abs(found - change).max() < 1e-5 * np.abs(change).max() + round_off


def test_body_and_collider_push_each_other_alike(jelly_body, dim, mechanics, law):
    """What moves the body as a whole does to the energy is the force on the collider, friction included."""
    rows, poses = strained(jelly_body), {"ball": ball_at(dim, 0.006, 0.001)}
    friction = CondensedFriction(CoulombFriction(0.4))
    after, slip = lag_at(jelly_body, mechanics, law, ball_at(dim, 0.005), poses["ball"], rows, rows)
    sliding = friction.lag(after, poses, slip)
    normal = after.forces()
    found = friction.evaluate(sliding, rows, poses, TIME_STEP)
    force = found.added_to(normal)["ball"].force
    gradient = after.gradient + found.linearise({})[0]
    # All nodes move along with the rows to 1e-12: the basis sums to one.
    expected = jelly_body.handles.affine_part @ gradient
    np.testing.assert_allclose(expected, force, atol=1e-9 * np.linalg.norm(force))
    length = np.linalg.norm(normal["ball"].force)
    assert (force - normal["ball"].force)[0] < -0.1 * length  # the body holds the ball back


def test_moving_along_with_the_collider_is_no_slip(jelly_body, dim, mechanics, law, monkeypatch):
    """Exactly so for any rigid motion of U rows; static condensation keeps the frame of the step's start, and so
    follows translations only."""
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 1e-8)
    start, begin = strained(jelly_body), ball_at(dim, 0.006)
    spin = [0.4] if dim == 2 else [0.1, 0.4, -0.2]
    motion = RigidPose.from_rotation_vector(
        np.zeros(len(spin)) if mechanics.condensation else spin, np.linspace(0.02, 0.05, dim)
    )
    rows = start @ motion.rotation.T + np.outer(jelly_body.handles.affine_part, motion.translation)
    friction, poses = CondensedFriction(CoulombFriction(0.4)), {"ball": motion.compose(begin)}
    after, slip = lag_at(jelly_body, mechanics, law, begin, poses["ball"], start, rows)
    (sliding,) = friction.lag(after, poses, slip).values()
    terms = friction.settled(sliding, rows, poses["ball"], TIME_STEP).terms
    assert len(terms.index) >= 3
    weight = 0.4 * sliding.lagged.force
    # Contact is solved to 1e-8 of the depth, 6e-11 m; a node that slips so far feels 2e-11/eps of mu N.
    assert np.all(np.linalg.norm(terms.gradient, axis=1) <= 1e-4 * weight)


def dragged(body, mechanics, law, mu):
    """The ball pressed in by 5 mm, then dragged along by 0.5 mm a step. Yields simulator, state before, result of every
    step of the drag."""
    friction = None if mu is None else CoulombFriction(mu, slip_velocity=1e-3)
    simulator = block(
        body, mechanics, friction, law, newton=NewtonSettings(max_iterations=40, tolerance=1e-6)
    )
    dim = body.dim
    path = [ball_at(dim, depth) for depth in np.linspace(0.0, DEPTH, 6)]
    path += [ball_at(dim, DEPTH, along) for along in STRIDE * np.arange(1, 15)]
    state = simulator.rest_state(poses={"ball": ball_at(dim, -0.001)})
    for pose in path:
        result = simulator.step(state, poses={"ball": pose})
        assert result.converged, result.reason
        if pose.translation[0] > 0.0:
            yield simulator, state, result
        state = result.state


def points_and_slip(contact, before, after):
    """The points that bear pressure after a step, and by how much they slipped along the ball (k, dim) [m]."""

    def evaluated(state):
        return contact.evaluation(contact.in_frame(state.frame), state.rows, state.contact)

    at = evaluated(after)
    active = at.active_points("ball")
    start = evaluated(before).deformed_positions(active.index, friction=before.friction)
    end = at.deformed_positions(active.index, friction=after.friction)
    u = end - after.poses["ball"].apply(before.poses["ball"].apply_inverse(start))
    normal = active.normal / np.linalg.norm(active.normal, axis=1, keepdims=True)
    return active, u - (u * normal).sum(axis=1, keepdims=True) * normal


def measured(body, mechanics, law, mu):
    """Of every step of a drag: friction on the ball over mu N, along the path, and the mean slip over the stride."""
    contact, shares, slips = contact_with_ball(body, mechanics, law), [], []
    for simulator, before, result in dragged(body, mechanics, law, mu):
        active, u = points_and_slip(contact, before, result.state)
        normal = simulator.contact_forces(result.state)["ball"].force  # leaves friction out
        friction = result.contacts["ball"].force - normal
        bound = mu * active.pressure.sum()
        # The normal forces that friction has taken up are those of the third iteration; measured 4e-3.
        assert np.linalg.norm(friction) < 1.01 * bound
        shares.append(friction[0] / bound)
        slips.append(-(active.pressure @ u)[0] / active.pressure.sum() / STRIDE)
    return np.array(shares), np.array(slips)


def test_a_ball_dragged_with_less_than_coulomb_s_force_takes_the_body_along(jelly_body, mechanics, few):
    shares, slips = measured(jelly_body, mechanics, few, 5.0)
    # As a spring, the body holds back more and more, once what friction held while pressing has turned about.
    assert np.all(np.diff(shares[2:]) < 0)
    assert shares[-1] > -0.7
    # Sticking creeps, by up to slip_velocity h = 10 um of 500 um; and the dent, of which friction bends nothing along
    # the normals, slips a little on the ball wherever it changes.
    assert np.abs(slips).max() < 0.1


@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_a_ball_dragged_with_coulomb_s_force_slips(jelly_body, mechanics, few, mu):
    shares, slips = measured(jelly_body, mechanics, few, mu)
    # Every node is held back by mu N exactly; but their tangents to the ball differ, by up to 0.3 rad: 1 - 0.3^2 / 6.
    assert shares[8:] == pytest.approx(-1.0, abs=0.02)
    # The ball goes on and the body stays where it is, but for what the force changes from place to place, and the
    # surface gives way to it: measured 10 %.
    assert slips[-1] == pytest.approx(1.0, abs=0.15)


def test_the_surface_is_pressed_where_friction_has_dragged_it(jelly_body, dim, mechanics, few):
    """It sticks to the ball, which is round: were pressure that on the surface as it is without friction, points would
    end up to 0.4 mm deeper in the ball, or farther out, than their pressure says."""
    contact = contact_with_ball(jelly_body, mechanics, few)
    for _, _, result in dragged(jelly_body, mechanics, few, 5.0):
        after = result.state
        at = contact.evaluation(contact.in_frame(after.frame), after.rows, after.contact)
        active = at.active_points("ball")
        y = at.deformed_positions(active.index, friction=after.friction)
        depth = RADIUS - np.linalg.norm(y - after.poses["ball"].translation, axis=1)
        # Friction is known from an iteration before the last: measured 3 um, of 0.5 to 1.3 mm.
        assert np.abs(depth - active.penetration).max() < 0.02 * active.penetration.max()
    way = np.linalg.norm(y - at.deformed_positions(active.index), axis=1).max()
    assert way > {2: 3e-4, 3: 2e-3}[dim]


def test_a_coefficient_of_zero_is_no_friction(jelly_body, mechanics, few, monkeypatch):
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 1e-9)  # solves start from others, and so end at others
    for with_it, without in zip(
        dragged(jelly_body, mechanics, few, 0.0), dragged(jelly_body, mechanics, few, None), strict=True
    ):
        assert with_it[2].iterations == without[2].iterations
        # Round-off of metres.
        np.testing.assert_allclose(with_it[2].state.rows, without[2].state.rows, rtol=0, atol=1e-12)
        assert with_it[2].energies["friction"] == 0.0


def test_a_step_whose_contact_solve_fails_says_so(jelly_body, dim, mechanics, few, monkeypatch):
    """With a tolerance below round-off no contact solve converges, though the handles balance."""
    simulator = block(jelly_body, mechanics, None, few)
    state = simulator.rest_state(poses={"ball": ball_at(dim, 0.004)})
    result = simulator.step(state, poses=state.poses)
    assert result.status is Status.CONVERGED
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 0.0)
    monkeypatch.setattr(contact_solve, "_DESCENT_ITERATIONS", 5)
    failed = simulator.step(state, poses=state.poses)
    assert failed.status is Status.CONTACT_UNSOLVED
    assert "contact solve" in failed.reason
    # What is found is the same: both stop within the tolerance of the step, 1e-4 of the forces.
    np.testing.assert_allclose(failed.state.rows, result.state.rows, atol=1e-3 * DEPTH)
