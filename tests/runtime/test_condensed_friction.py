"""Friction on condensed contact: derivatives, Coulomb's law, and a ball dragged over the top of a held block."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from runtime.colliders import RigidPose, Sphere
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.contact.condensed import contact_solve
from runtime.contact.condensed.condensed_contact import CondensedContact
from runtime.contact.condensed.contact_potential import ContactPotential
from runtime.contact.condensed.equilibrium import LoadProbe
from runtime.contact.friction_state import FrictionState
from runtime.dynamics import DynamicsSettings, KinematicHandle, NewtonSettings, PlacedCollider, Simulator
from runtime.dynamics import simulator as simulator_module
from runtime.mechanics.body_mechanics import compute_mechanics
from runtime.mechanics.static_condensation import StaticCondensation

STIFFNESS = 1e10  # N/m^4
TIME_STEP = 0.01
TOP = 0.06  # m, of the block
RADIUS = 0.06
DEPTH, STRIDE = 0.005, 5e-4


@dataclass(frozen=True, eq=False)
class PotentialAlone:
    """A correction of which nobody asks the field."""

    potential: ContactPotential
    internal: StaticCondensation | None
    name, collider, support = "potential", "ball", np.inf


def correction_of(body, internal):
    """In float64, so that finite differences see the derivatives and not the rounding of what is kept."""
    mechanics = compute_mechanics(body, 400, internal)
    found = mechanics.internal
    if found is not None:
        modes, weight = found.modes.astype(np.float64), found.weight.astype(np.float64)
        mechanics = mechanics._replace(internal=replace(found, modes=modes, weight=weight))
    probe = LoadProbe(body, Sphere(RADIUS, body.dim, "ball"), mechanics, STIFFNESS)
    return PotentialAlone(ContactPotential(probe), mechanics.internal)


@pytest.fixture(params=[False, True], ids=["bare", "internal"])
def correction(jelly_body, request):
    return correction_of(jelly_body, request.param)


def ball_at(dim, depth, along=0.0):
    """The pose of a ball so deep in the middle of the top, moved along the first axis."""
    return RigidPose(np.eye(dim), np.append(np.eye(dim - 1)[0] * along, TOP + RADIUS - depth))


def block(body, correction, friction, **settings):
    """Held by its base, under a ball that the caller places."""
    return Simulator(
        body,
        [PlacedCollider("ball", Sphere(RADIUS, body.dim, "ball"), None, correction)],
        contact=PenaltyContact(STIFFNESS),
        friction=friction,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(TIME_STEP, **settings),
        internal=correction.internal,
    )


def strained(body, seed=5):
    rng = np.random.default_rng(seed)
    return body.rest_rows + 1e-3 * rng.normal(size=body.rest_rows.shape)


def lag_at(correction, friction, begin, end, rows, start_rows, turn):
    """The condensed contact of a step, its friction taken up at rows."""
    contact = CondensedContact({"ball": correction.potential}, friction)
    poses = {"ball": end}
    settled = contact.settled(start_rows, {"ball": begin}, turn)
    step = FrictionState(np.empty((0, rows.shape[1])), {"ball": begin}, TIME_STEP, settled)
    energy, gradient, hessian = contact.linearise(rows, poses, turn, step, relag=True)
    return contact, poses, step, (energy, gradient, hessian)


def test_derivatives_of_the_energy_of_a_step(jelly_body, dim, correction, monkeypatch):
    """The friction is that of a ball that has moved on by 1 mm; eps = slip_velocity h is 1 mm as well."""
    problems = []

    def keep(problem, start, settings, solving):
        problems.extend([problem, start])
        raise StopIteration

    monkeypatch.setattr(simulator_module, "minimise", keep)
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 1e-12)  # differences over 1e-7 m see what is left
    simulator = block(jelly_body, correction, CoulombFriction(0.4, slip_velocity=0.1))
    state = simulator.rest_state(poses={"ball": ball_at(dim, 0.004)})
    with pytest.raises(StopIteration):
        simulator.step(state, poses={"ball": ball_at(dim, 0.005, 0.001)})
    problem, start = problems
    rng = np.random.default_rng(dim)
    x = start._replace(rows=state.rows)
    x = problem.retract(x, 1e-3 * rng.normal(size=jelly_body.handles.n_points * dim))
    at = problem.linearise(x)
    problem._relags_left = 0
    contact, friction, _ = problem.contacts(problem.evaluate(x))
    assert contact > 0
    assert friction > 0
    assert at.energy == pytest.approx(problem.energy(x), rel=1e-12)  # the same sums in another order
    for _ in range(4):
        way, h = rng.normal(size=len(at.gradient)), 1e-7
        ahead, behind = problem.retract(x, h * way), problem.retract(x, -h * way)
        slope = (problem.energy(ahead) - problem.energy(behind)) / (2 * h)
        # Central differences over 1e-7 m: a part in a million.
        assert slope == pytest.approx(at.gradient @ way, rel=1e-5, abs=1e-6 * at.scale)
        # Only points are free, so that gradients at different rows are in the same coordinates.
        change = (problem.linearise(ahead).gradient - problem.linearise(behind).gradient) / (2 * h)
        # The second derivative of penalty has a kink where a load starts to bear.
        assert np.abs(at.hessian @ way - change).max() < 1e-4 * np.abs(change).max()


@pytest.mark.parametrize("slip_velocity", [0.01, 1.0], ids=["slips", "sticks"])
def test_friction_alone_has_exact_derivatives(jelly_body, dim, correction, slip_velocity):
    """eps = slip_velocity h is 0.1 mm and 10 mm, for a ball that moved on by 1 mm."""
    rows, turn, law = strained(jelly_body), jelly_body.rest_rows, CoulombFriction(0.4, slip_velocity)
    begin, end = ball_at(dim, 0.005), ball_at(dim, 0.006, 0.001)
    contact, poses, step, _ = lag_at(correction, law, begin, end, rows, jelly_body.rest_rows, turn)
    friction = contact._friction
    way, h = np.random.default_rng(0).normal(size=rows.shape), 1e-7
    at, ahead, behind = (
        friction.linearise("ball", rows + side * h * way, poses, step) for side in (0, 1, -1)
    )
    # No solve inside: round-off of 1e-16 of the energy over 1e-7 of a feature of 1e-3 m.
    assert (ahead[0] - behind[0]) / (2 * h) == pytest.approx(np.vdot(at[1], way), rel=1e-6)
    change = (ahead[1] - behind[1]) / (2 * h)
    # In 2D what slips has no stiffness: what is left is round-off of a force over 1e-7 m.
    round_off = 1e-15 * np.abs(at[1]).max() / h
    found = (at[2]() @ way.ravel()).reshape(rows.shape)
    assert np.abs(found - change).max() < 1e-6 * np.abs(change).max() + round_off


def test_body_and_collider_push_each_other_alike(jelly_body, dim, correction):
    """What moves the body as a whole does to the energy is the force on the collider, friction included."""
    rows, turn = strained(jelly_body), jelly_body.rest_rows
    begin, end = ball_at(dim, 0.005), ball_at(dim, 0.006, 0.001)
    law = CoulombFriction(0.4)
    contact, poses, step, found = lag_at(correction, law, begin, end, rows, rows, turn)
    force = contact.forces(rows, poses, turn, step)[2]["ball"].force
    frame = np.append(np.zeros(dim), 1.0)
    positions = np.append(np.ones(jelly_body.handles.n_points), frame)
    # All loads move along with the rows to 1e-12: the basis sums to one.
    np.testing.assert_allclose(positions @ found[1], force, atol=1e-9 * np.linalg.norm(force))
    normal = contact.forces(rows, poses, turn, None)[2]["ball"].force
    assert (force - normal)[0] < -0.1 * np.linalg.norm(normal)  # the body holds the ball back


def test_moving_along_with_the_collider_is_no_slip(jelly_body, dim, correction):
    """Exactly so for any rigid motion of U rows; the internal response keeps the turn of the step's start, and
    so follows translations only."""
    start, begin = strained(jelly_body), ball_at(dim, 0.006)
    spin = [0.4] if dim == 2 else [0.1, 0.4, -0.2]
    motion = RigidPose.from_rotation_vector(
        np.zeros(len(spin)) if correction.internal else spin, np.linspace(0.02, 0.05, dim)
    )
    rows = start @ motion.rotation.T
    rows[[*range(jelly_body.handles.n_points), -1]] += motion.translation
    law = CoulombFriction(0.4)
    contact, poses, step, _ = lag_at(
        correction, law, begin, motion.compose(begin), rows, start, jelly_body.rest_rows
    )
    terms = contact._friction.terms("ball", rows, poses, step)
    assert len(terms.index) >= 3
    weight = 0.4 * step.sliding["ball"].lagged.force
    # The press is solved to 1e-8 of the depth, 6e-11 m; a load that slips so far feels 2e-11/eps of mu N.
    assert np.all(np.linalg.norm(terms.gradient, axis=1) <= 1e-4 * weight)


def dragged(body, correction, mu):
    """The ball pressed in by 5 mm, then dragged along by 0.5 mm a step. Yields simulator, state before, result of every
    step of the drag."""
    friction = None if mu is None else CoulombFriction(mu, slip_velocity=1e-3)
    simulator = block(body, correction, friction, newton=NewtonSettings(max_iterations=40, tolerance=1e-6))
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


def loads_and_slip(potential, before, after):
    """The loads that bear pressure after a step, and by how much they slipped along the ball (k, dim) [m]."""
    loads = potential.pressed(after.rows, after.poses["ball"], after.turn)
    start = potential.settled(before.rows, before.poses["ball"], before.turn)(loads.index)
    u = loads.position - after.poses["ball"].apply(before.poses["ball"].apply_inverse(start))
    normal = loads.normal / np.linalg.norm(loads.normal, axis=1, keepdims=True)
    return loads, u - (u * normal).sum(axis=1, keepdims=True) * normal


def measured(body, correction, mu):
    """Of every step of a drag: friction on the ball over mu N, along the path, and the mean slip over the stride."""
    shares, slips = [], []
    for simulator, before, result in dragged(body, correction, mu):
        loads, u = loads_and_slip(correction.potential, before, result.state)
        normal = simulator.contact_forces(result.state)["ball"].force  # leaves friction out
        friction = result.contacts["ball"].force - normal
        bound = mu * loads.pressure.sum()
        # The normal forces that friction has taken up are those of the third iteration; measured 4e-3.
        assert np.linalg.norm(friction) < 1.01 * bound
        shares.append(friction[0] / bound)
        slips.append(-(loads.pressure @ u)[0] / loads.pressure.sum() / STRIDE)
    return np.array(shares), np.array(slips)


def test_a_ball_dragged_with_less_than_coulomb_s_force_takes_the_body_along(jelly_body, correction):
    shares, slips = measured(jelly_body, correction, 5.0)
    # As a spring, the body holds back more and more, once what friction held while pressing has turned about.
    assert np.all(np.diff(shares[2:]) < 0)
    assert shares[-1] > -0.7
    # Sticking creeps, by up to slip_velocity h = 10 um of 500 um; and the dent, which friction does not bend,
    # slips a little on the ball wherever it changes. Measured 6 % at first, 5 % later on.
    assert np.abs(slips).max() < 0.1


@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_a_ball_dragged_with_coulomb_s_force_slips(jelly_body, correction, mu):
    shares, slips = measured(jelly_body, correction, mu)
    # Every load is held back by mu N exactly; but their tangents to the ball differ, by up to 0.3 rad: 1 - 0.3^2 / 6.
    assert shares[8:] == pytest.approx(-1.0, abs=0.02)
    # The ball goes on and the body stays where it is, but for what the force changes from place to place: measured 7 %.
    assert slips[-1] == pytest.approx(1.0, abs=0.1)


def test_a_coefficient_of_zero_is_no_friction(jelly_body, correction, monkeypatch):
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 1e-9)  # presses start from others, and so end at others
    for with_it, without in zip(
        dragged(jelly_body, correction, 0.0), dragged(jelly_body, correction, None), strict=True
    ):
        assert with_it[2].iterations == without[2].iterations
        # Round-off of metres.
        np.testing.assert_allclose(with_it[2].state.rows, without[2].state.rows, rtol=0, atol=1e-12)
        assert with_it[2].energies["friction"] == 0.0
