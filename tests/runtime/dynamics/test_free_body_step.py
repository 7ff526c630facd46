"""Steps with free rigid bodies: derivatives by finite differences, with all terms active."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from softprint.runtime.colliders import Box, Capsule, Plane, RigidPose
from softprint.runtime.colliders.path import KeyframedPath
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.contact.solver import contact_solve
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.dynamics.step import held_hardening
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.optimise import Minimum, Newton, Status
from softprint.runtime.rigid import RigidMotion, free_collider

STIFFNESS = 1e10  # N/m^4
TIME_STEP = 0.01
TOP = 0.06  # m, of the block


@dataclass(frozen=True, eq=False)
class FieldNobodyAsksFor:
    """A field correction of a collider."""

    collider: str
    name, support = "field", np.inf


def mechanics_of(body, gravity):
    """In float64, so that finite differences resolve the derivatives and not the rounding of stored data."""
    mechanics = compute_mechanics(body, 400, True, gravity)
    found = mechanics.condensation
    modes, weight = found.modes.astype(np.float64), found.weight.astype(np.float64)
    return mechanics._replace(condensation=replace(found, modes=modes, weight=weight))


def capsule(dim, name):
    half = 0.012 * np.eye(dim)[0]
    return Capsule(-half, 2.0 * half, 0.012, name)  # its centre of mass is not its origin


def posed(dim, rotation, *position):
    return RigidPose.from_rotation_vector(
        rotation[:1] if dim == 2 else rotation, [*position[: dim - 1], position[-1]]
    )


ENERGY = (1.0,)


def learned_on(shape, body, mechanics, refinement, energy):
    """A correction with a learned energy, which is of all contacts of the body."""
    options = ForceModelOptions((4, 4), "silu", 5e-4, 3e-3, STIFFNESS, refinement=refinement, energy=energy)
    return ForceCorrection("learned", ForceModel(options, body.dim, body.n_rows), body, shape, mechanics)


def scene(body, dim, mechanics, refinement, sharp, learned, optimiser=None):
    """One capsule (or box, with sharp edges) deep in the top of a fixed block, one that leans on it and on a wall, and
    one that stands upright in the top beside them; all spin."""
    gravity = np.append(np.zeros(dim - 1), -9.81)
    starts = {
        "low": posed(dim, [0.3, -0.2, 0.5], 0.002, 0.007, TOP + 0.006),
        "high": posed(dim, [0.4, 0.1, -0.3], 0.022, 0.002, TOP + 0.03),
        "beside": posed(dim, [1.5] if dim == 2 else [0.1, -1.5, 0.2], -0.035, -0.008, TOP + 0.018),
    }
    colliders = []
    for name, pose in starts.items():
        shape = Box([0.02, 0.01, 0.01][:dim], name=name) if sharp and name == "low" else capsule(dim, name)
        spin = [3.0] if dim == 2 else [3.0, -2.0, 1.0]
        velocity = np.linspace(-0.2, 0.1, dim)
        free = free_collider(shape, pose, density=2000.0, velocity=velocity, spin=spin)
        correction = (
            learned_on(shape, body, mechanics, refinement, learned) if learned and name == "low" else None
        )
        colliders.append(PlacedCollider(name, shape, free=free, correction=correction))
    wall = KeyframedPath([0.0], [[0.048, *[0.0] * (dim - 1)]])
    colliders.append(PlacedCollider("wall", Plane(-np.eye(dim)[0], "wall"), wall))
    return Simulator(
        body,
        colliders,
        contact=PenaltyContact(STIFFNESS, refinement),
        mechanics=mechanics,
        friction=CoulombFriction(0.4, slip_velocity=0.1),
        gravity=gravity,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(TIME_STEP, optimiser=optimiser),
    )


@pytest.fixture(
    params=[
        ("penalty", 0, False, ()),
        ("condensed", 0, False, ()),
        ("penalty", 1, False, ()),
        ("condensed", 1, False, ()),
        ("penalty", 1, True, ()),
        ("condensed", 1, False, ENERGY),
    ],
    ids=[
        "penalty",
        "condensed",
        "penalty on facets",
        "condensed on facets",
        "penalty of sharp points",
        "learned energy",
    ],
)
def step(jelly_body, dim, request, monkeypatch):
    """The energy of a step, a point near its end, where friction is lagged, and a generator."""
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 1e-12)  # differences resolve the remaining ones
    gravity = np.append(np.zeros(dim - 1), -9.81)
    mechanics = mechanics_of(jelly_body, gravity) if request.param[0] == "condensed" else None
    simulator = scene(jelly_body, dim, mechanics, *request.param[1:])
    caught = []

    def catch(problem, start, newton, sliding):
        caught.extend([problem, start, sliding])
        raise StopIteration

    monkeypatch.setattr(held_hardening, "solve_step", catch)
    with pytest.raises(StopIteration):
        simulator.step(simulator.rest_state())
    problem, start, sliding = caught
    rng = np.random.default_rng(dim)
    size = jelly_body.handles.n_points * dim + simulator._free_bodies.size
    x = problem.retract(start, 5e-4 * rng.normal(size=size))
    # Steps take no iterate in which a collider goes deeper; here the energy is looked at in such.
    problem = replace(problem, lagged=problem.lag(x, sliding.slip), limit=None)
    assert x.body.surface.sharp.friction_energy(problem.lagged) > 0.0 or not request.param[2]
    return problem, problem.point(x.body), rng


def test_derivatives(step, dim):
    problem, x, rng = step
    at, n_rows = problem.linearise(x), x.body.at.rows[: -1 - dim].size
    contact, friction, forces = x.contacts()
    among = problem.free_bodies.among(x.body.at.poses, problem.lagged)
    assert forces["low"].points > 0
    assert forces["beside"].points > 0
    assert 0.0 < among[0] < contact  # body and colliders, and colliders among themselves
    assert 0.0 < among[1] < friction
    assert at.energy == pytest.approx(problem.energy(x), rel=1e-12)  # the same sums in another order
    n = len(at.gradient)
    assert n == n_rows + 3 * (dim + dim * (dim - 1) // 2)
    np.testing.assert_allclose(at.hessian, at.hessian.T, atol=2e-6 * np.abs(at.hessian).max())
    ways = rng.normal(size=(6, n))
    ways[3:, :n_rows] = 0.0  # of the colliders alone, too
    for way in ways / np.linalg.norm(ways, axis=1, keepdims=True):
        h = 1e-6
        ahead, behind = problem.retract(x, h * way), problem.retract(x, -h * way)
        slope = (problem.energy(ahead) - problem.energy(behind)) / (2 * h)
        # Steps of 1e-6 m on features of 1e-3 m.
        assert slope == pytest.approx(at.gradient @ way, rel=1e-5, abs=2e-6 * float(np.max(at.scale)))
        # Second differences along the retraction from one point; penalty has a kink where a point begins to touch.
        h = 1e-5
        e = [problem.energy(problem.retract(x, k * h * way)) for k in (-2, -1, 0, 1, 2)]
        bent = (-e[0] + 16 * e[1] - 30 * e[2] + 16 * e[3] - e[4]) / (12 * h**2)
        assert way @ at.hessian @ way == pytest.approx(bent, rel=1e-3)


def test_mixed_derivatives(step, dim):
    """Between body and each collider, and between colliders: mixed second differences of the energy."""
    problem, x, rng = step
    at = problem.linearise(x)
    n, twist = len(at.gradient), dim + dim * (dim - 1) // 2
    body = n - 3 * twist
    blocks = [slice(0, body), *(slice(body + k * twist, body + (k + 1) * twist) for k in range(3))]
    h = 5e-7
    for one, other in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3)):
        a, b = np.zeros(n), np.zeros(n)
        a[blocks[one]], b[blocks[other]] = rng.normal(size=n)[blocks[one]], rng.normal(size=n)[blocks[other]]
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        # Twists of different bodies and handles commute, so that one retraction serves both.
        e = {
            (i, j): problem.energy(problem.retract(x, h * (i * a + j * b))) for i in (-1, 1) for j in (-1, 1)
        }
        mixed = (e[1, 1] - e[1, -1] - e[-1, 1] + e[-1, -1]) / (4 * h**2)
        found = a @ at.hessian @ b
        # Of second order in 5e-7 m, in which points begin to bear; against the stiffness of the contact, of which this
        # is a part.
        stiff = np.sqrt(abs(a @ at.hessian @ a) * abs(b @ at.hessian @ b))
        assert found == pytest.approx(mixed, rel=2e-3, abs=1e-5 * stiff)
        # High does not touch the body; low and beside are coupled through it if contact is condensed.
        through = x.body.contact is not None and (one, other) == (1, 3)
        assert ((one, other) in ((0, 2), (1, 3)) and not through) == (found == 0.0)


def test_colliders_that_cannot_move_freely_are_refused(jelly_body, dim):
    shape, pose = capsule(dim, "low"), RigidPose.identity(dim)
    free = free_collider(shape, pose, mass=0.1)
    field = FieldNobodyAsksFor("low")
    with pytest.raises(SoftprintError, match=r"cannot move freely with it.* of form force"):
        Simulator(jelly_body, [PlacedCollider("low", shape, None, field, free)], contact=PenaltyContact(1e8))
    with pytest.raises(SoftprintError, match="can have no path"):
        Simulator(
            jelly_body,
            [PlacedCollider("low", shape, KeyframedPath.constant(pose), None, free)],
            contact=PenaltyContact(1e8),
        )
    simulator = Simulator(jelly_body, [PlacedCollider("low", shape, free=free)], contact=PenaltyContact(1e8))
    with pytest.raises(SoftprintError, match="leave its pose to the step"):
        simulator.step(simulator.rest_state(), {"low": pose})
    with pytest.raises(SoftprintError, match="density or a mass"):
        free_collider(shape, pose)
    with pytest.raises(SoftprintError, match="has no bounds"):
        free_collider(Plane(np.eye(dim)[0], "floor"), pose, density=1.0)
    with pytest.raises(SoftprintError, match="the spin of collider 'low'"):
        free_collider(shape, pose, density=1.0, spin=[1.0, 2.0])
    assert isinstance(free.motion, RigidMotion)


@dataclass(frozen=True)
class FindsNoMinimum(Newton):
    """Of the learned energy while it hardens, or of any."""

    of_any: bool = False

    def limited(self, iterations):
        return replace(self, settings=replace(self.settings, max_iterations=iterations))

    def minimise(self, problem, x, solving=None, earlier=None):
        if self.of_any or not x.body.frame.terms.condensed.learned.is_proportional:
            return Minimum(x, Status.LINE_SEARCH_FAILED, 1, np.inf, np.inf)
        return super().minimise(problem, x, solving, earlier)


def test_step_without_minimum_holds_the_hardening(jelly_body, dim):
    """And says so. Its forces hardly differ from those of the learned energy, where this has a minimum."""
    gravity = np.append(np.zeros(dim - 1), -9.81)
    mechanics, newton = mechanics_of(jelly_body, gravity), NewtonSettings(100, 1e-6)

    def simulator(optimiser):
        return scene(jelly_body, dim, mechanics, 1, False, ENERGY, optimiser)

    finds = simulator(Newton(newton))
    before = finds.step(finds.rest_state())
    for _ in range(2):  # bodies start so deep in each other that the first steps need not converge
        before = finds.step(before.state)
    again, learned = simulator(FindsNoMinimum(newton)).step(before.state), finds.step(before.state)
    assert before.converged
    assert learned.converged
    assert again.status is Status.HARDENING_HELD
    assert not again.converged
    assert "hardening of contact held" in again.reason
    assert again.residual <= newton.tolerance
    assert again.iterations > 1
    assert again.state.factorisation is None
    # With a few iterations allowed, as in real time, a step that ran out of them is not solved a second time.
    for few in (1, 4):
        step = simulator(Newton(NewtonSettings(few, 1e-12))).step(before.state)
        assert step.status is Status.MAX_ITERATIONS
        assert step.iterations <= few
    # The excess changes by a few per cent in a step.
    reference = learned.contacts["low"].force
    np.testing.assert_allclose(again.contacts["low"].force, reference, atol=0.05 * np.linalg.norm(reference))
    lost = simulator(FindsNoMinimum(newton, of_any=True)).step(before.state)
    assert lost.status is Status.LINE_SEARCH_FAILED
