"""Newton's method: exact on quadratics, downhill from saddle points, correct statuses; and another optimiser in its
place."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import minimize

from softprint.runtime.colliders import Box, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.errors import SoftprintError
from softprint.runtime.optimise import Linearisation, Minimum, Newton, NewtonSettings, Status
from softprint.runtime.optimise.descent import Descent
from softprint.runtime.truth.truth_schema import STATUS_NAMES, UNREACHED


class Smooth:
    """E(x) of plain numbers; `pieces` gives energy, gradient and Hessian."""

    def __init__(self, pieces):
        self.pieces = pieces

    def linearise(self, x):
        energy, gradient, hessian = self.pieces(x)
        return Linearisation(energy, 1e-13 * abs(energy), gradient, lambda: hessian, scale=1.0)

    def energy(self, x):
        return self.pieces(x)[0]

    def retract(self, x, v):
        return x + v

    def longest(self, x, v):
        return 1.0


def quadratic(x):
    matrix, force = np.diag([1.0, 4.0, 100.0]), np.array([1.0, -2.0, 3.0])
    return 0.5 * x @ matrix @ x - force @ x, matrix @ x - force, matrix


def double_well(x):
    """(x0^2 - 1)^2 + x1^2: a saddle at 0, where the Hessian is indefinite, and minima at (+-1, 0)."""
    energy = (x[0] ** 2 - 1) ** 2 + x[1] ** 2
    gradient = np.array([4 * x[0] * (x[0] ** 2 - 1), 2 * x[1]])
    return energy, gradient, np.diag([12 * x[0] ** 2 - 4, 2.0])


def test_a_quadratic_takes_one_step():
    result = Newton().minimise(Smooth(quadratic), np.zeros(3))
    assert result.converged
    assert result.iterations == 1
    np.testing.assert_allclose(result.x, [1.0, -0.5, 0.03], rtol=1e-14)  # a diagonal solve: round-off


def test_a_hessian_is_reused_if_that_is_enough():
    """|x|^2 / 2 + |x|^4 / 4 from x = 0.2: the errors of Newton's method are 0.014 and then 6e-6; with the first Hessian
    reused, which is too stiff by a tenth, the second is 1.5e-3."""
    asked = []

    class Counted(Smooth):
        def linearise(self, x):
            at = super().linearise(x)
            return Linearisation(
                at.energy, at.noise, at.gradient, lambda: asked.append(x) or at.hessian, at.scale
            )

    def quartic(x):
        square = x @ x
        hessian = (1.0 + square) * np.eye(2) + 2.0 * np.outer(x, x)
        return 0.5 * square + 0.25 * square**2, (1.0 + square) * x, hessian

    begin = np.array([0.2, 0.0])
    rough = Newton(NewtonSettings(tolerance=3e-3)).minimise(Counted(quartic), begin)
    assert (rough.converged, rough.iterations, len(asked)) == (True, 2, 1)
    asked.clear()
    fine = Newton(NewtonSettings(tolerance=1e-4)).minimise(Counted(quartic), begin)
    assert (fine.converged, fine.iterations, len(asked)) == (True, 2, 2)


def test_one_iteration_does_not_claim_convergence():
    result = Newton(NewtonSettings(max_iterations=1)).minimise(Smooth(quadratic), np.zeros(3))
    assert result.status is Status.MAX_ITERATIONS
    assert not result.converged
    assert result.residual == pytest.approx(np.sqrt(14.0))  # of the start, which is the last it has seen
    assert "iterations ran out" in result.reason
    assert result.decrement == pytest.approx(0.5 * (1 + 1 + 0.09))  # 1/2 f K^-1 f


def test_negative_curvature_leads_to_a_minimum():
    result = Newton(NewtonSettings(tolerance=1e-10)).minimise(Smooth(double_well), np.array([0.1, 1.0]))
    assert result.converged
    np.testing.assert_allclose(result.x, [1.0, 0.0], atol=1e-9)  # tolerance over the curvature 8


def test_the_direction_is_downhill_for_any_symmetric_hessian():
    rng = np.random.default_rng(1)
    for _ in range(20):
        matrix = rng.normal(size=(6, 6))
        gradient = rng.normal(size=6)
        assert gradient @ Descent(matrix + matrix.T)(gradient) < 0


def test_energies_that_are_not_finite_are_named():
    result = Newton().minimise(Smooth(lambda x: (np.inf, x, np.eye(2))), np.ones(2))
    assert result.status is Status.NOT_FINITE
    assert "not finite" in result.reason


def test_a_failed_line_search_is_reported():
    """A wrong gradient: the energy increases along every search direction."""
    result = Newton().minimise(Smooth(lambda x: (x @ x, -2 * x, np.eye(2))), np.ones(2))
    assert result.status is Status.LINE_SEARCH_FAILED
    np.testing.assert_array_equal(result.x, np.ones(2))


@pytest.mark.parametrize(
    ("settings", "options"),
    [
        (NewtonSettings, {"max_iterations": 0}),
        (NewtonSettings, {"max_iterations": 2.5}),
        (NewtonSettings, {"tolerance": 0.0}),
        (NewtonSettings, {"tolerance": np.nan}),
        (NewtonSettings, {"tolerance": np.inf}),
        (NewtonSettings, {"tolerance": "1e-4"}),
        (DynamicsSettings, {"time_step": 0.0}),
        (DynamicsSettings, {"time_step": np.nan}),
        (DynamicsSettings, {"time_step": "1/60"}),
        (DynamicsSettings, {"friction_updates": 0}),
        (DynamicsSettings, {"friction_updates": 1.5}),
    ],
    ids=str,
)
def test_settings_that_make_no_sense_are_refused(settings, options):
    with pytest.raises(SoftprintError, match="must be"):
        settings(**options)


def test_numbers_of_numpy_are_settings():
    assert NewtonSettings(np.int64(3), np.float32(1e-3)).max_iterations == 3
    assert DynamicsSettings(np.float64(0.01), friction_updates=np.int32(2)).time_step == 0.01


def test_a_jump_beside_the_minimum_is_reported_early():
    """A parabola with a jump of the energy before its minimum: at the jump forces do not balance, and yet the energy
    cannot decrease."""

    def cliff(x):
        return 0.5 * x @ x + float(x[0] < 0.01), x.copy(), np.eye(1)

    result = Newton(NewtonSettings(max_iterations=200, tolerance=1e-6)).minimise(Smooth(cliff), np.ones(1))
    assert result.status is Status.STALLED
    assert not result.converged
    assert "hardly decreases further" in result.reason
    # Six steps of less than a fiftieth of the way to the minimum.
    assert result.x[0] == pytest.approx(0.01, rel=0.05)
    assert result.residual == pytest.approx(0.01, rel=0.05)
    assert result.iterations < 60


def test_status_numbers_are_those_in_files():
    numbers = {"CONVERGED": 0, "MAX_ITERATIONS": 1, "LINE_SEARCH_FAILED": 2, "UNSTABLE": 3, "NOT_FINITE": 4}
    assert {status.name: int(status) for status in Status} == {
        **numbers,
        "STALLED": 5,
        "PIERCED": 6,
        "CONTACT_UNSOLVED": 7,
        "CORRECTION_UNSOLVED": 8,
        "HARDENING_HELD": 9,
    }
    assert all(status.sentence.endswith(".") for status in Status)
    names = {number: name.lower() for name, number in numbers.items()}
    assert {**names, UNREACHED: "unreached"} == STATUS_NAMES


@dataclass(frozen=True)
class TrustRegion:
    """An `Optimiser`: scipy's nearly exact trust-region method, for unknowns that add (no frames)."""

    tolerance: float
    max_iterations: int = 100

    def limited(self, iterations):
        return replace(self, max_iterations=iterations)

    def minimise(self, problem, x, solving=None, earlier=None):
        begin = problem.linearise(x)
        found = minimize(
            lambda v: problem.energy(problem.retract(x, v)),
            np.zeros_like(begin.gradient),
            jac=lambda v: problem.linearise(problem.retract(x, v)).gradient,
            hess=lambda v: problem.linearise(problem.retract(x, v)).hessian,
            method="trust-exact",
            # The scale at the end may be smaller than at the start.
            options={
                "gtol": 0.1 * self.tolerance * begin.scale,
                "initial_trust_radius": 0.01,
                "maxiter": self.max_iterations,
            },
        )
        reached = problem.retract(x, found.x)
        residual = problem.linearise(reached).residual
        status = Status.CONVERGED if residual <= self.tolerance else Status.MAX_ITERATIONS
        return Minimum(reached, status, found.nit, residual)


def test_another_optimiser_finds_the_same_steps(jelly_body):
    """A block bulges away from a sphere pressed into it: the same motion with either method of minimisation."""
    dim = jelly_body.dim
    top = 0.06 * np.eye(dim)[-1]
    ball = PlacedCollider("ball", Sphere(0.02, dim=dim))
    pose = {"ball": RigidPose(np.eye(dim), top + 0.012 * np.eye(dim)[-1])}
    results = []
    for optimiser in (None, TrustRegion(1e-6)):
        settings = DynamicsSettings(1 / 60, NewtonSettings(50, 1e-6), optimiser=optimiser)
        simulator = Simulator(
            jelly_body,
            [ball],
            contact=PenaltyContact(1e9),
            gravity=-9.81 * np.eye(dim)[-1],
            kinematic=[KinematicHandle("base")],
            settings=settings,
        )
        state = simulator.rest_state(poses=pose)
        for _ in range(3):
            result = simulator.step(state, pose)
            assert result.status is Status.CONVERGED, result.reason
            state = result.state
        assert np.linalg.norm(result.contacts["ball"].force) > 0.01
        results.append(state.rows)
    moved = np.abs(results[0] - jelly_body.rest_rows).max()
    assert moved > 1e-4
    # Residuals of 1e-6, and contact stiffens: the softest mode has up to 1e2 times that in displacement.
    np.testing.assert_allclose(results[1], results[0], atol=1e-4 * moved)


def test_another_optimiser_finds_the_same_friction(jelly_body):
    """A plate that slides over a block: normal forces are renewed until they change no more, however each minimisation
    went."""
    dim = jelly_body.dim
    along, up = np.eye(dim)[0], np.eye(dim)[-1]
    plate = PlacedCollider("plate", Box([0.03] * dim))
    poses = [{"plate": RigidPose(np.eye(dim), 0.0885 * up + 0.002 * step * along)} for step in range(3)]
    forces = []
    for optimiser in (None, TrustRegion(1e-6, 200)):
        simulator = Simulator(
            jelly_body,
            [plate],
            contact=PenaltyContact(1e9),
            friction=CoulombFriction(0.3),
            kinematic=[KinematicHandle("base")],
            settings=DynamicsSettings(1 / 60, NewtonSettings(100, 1e-6), 30, optimiser),
        )
        state = simulator.rest_state(poses=poses[0])
        for pose in poses:
            result = simulator.step(state, pose)
            assert result.status is Status.CONVERGED, result.reason
            state = result.state
        forces.append(result.contacts["plate"].force)
    normal = forces[0] @ up
    assert -forces[0] @ along > 0.2 * normal > 0  # it slides
    # Residuals of 1e-6, of forces that lagging takes up once more.
    np.testing.assert_allclose(forces[1], forces[0], atol=1e-5 * normal)
