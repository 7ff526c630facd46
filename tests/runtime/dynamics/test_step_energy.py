"""The energy of a step: its gradient and Hessian by finite differences, in 2D and 3D, with all terms
active."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import Box, KeyframedPath, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.dynamics.step import held_hardening
from softprint.runtime.elasticity import make_material
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.static_condensation import compute_static_condensation
from softprint.runtime.mesh import box_mesh

TIME_STEP = 0.01
dims = pytest.mark.parametrize("dim", [2, 3])
kinds = pytest.mark.parametrize("corrected", [False, True], ids=["bare", "corrected"])
points = pytest.mark.parametrize(
    ("refinement", "sharp"),
    [(0, False), (1, False), (1, True)],
    ids=["at nodes", "on facets", "and of sharp points"],
)
subspaces = pytest.mark.parametrize("condensed", [False, True], ids=["U", "condensed"])


class WavyCorrection:
    """u = R s(U rows, z-centre): a smooth made-up field in collider space with an exact Jacobian.

    Every third point is not corrected, so that cells and contacts are corrected in part. With z = T^-1 (U rows):
    r_a = amplitude sin(k_a . z + c (U rows at the first handle)_a).
    """

    name, collider, support = "wavy", "ball", np.inf

    def __init__(self, amplitude):
        self.amplitude = amplitude

    def bind(self, points, reach=np.inf):
        return BoundWave(points.basis, self.amplitude)


class BoundWave:
    def __init__(self, basis, amplitude):
        self.basis, self.amplitude = basis, amplitude
        self.waves = 40.0 * np.random.default_rng(3).normal(size=(3, 3))
        self.active = np.flatnonzero(np.arange(len(basis)) % 3)

    def _phase(self, rows, pose):
        dim = rows.shape[1]
        z = pose.apply_inverse(self.basis @ rows)
        return z @ self.waves[:dim, :dim].T + 7.0 * pose.apply_inverse(rows[:1])

    def displacement(self, rows, pose):
        u = np.zeros((len(self.basis), rows.shape[1]))
        u[self.active] = pose.rotate(self.amplitude * np.sin(self._phase(rows, pose)[self.active]))
        return u

    def linearise(self, rows, pose):
        dim = rows.shape[1]
        slope = self.amplitude * np.cos(self._phase(rows, pose)[self.active])  # (n, a), collider space
        first = np.eye(1, len(rows)).ravel()
        # d phase_a / d rows_rb = sum_c waves_ac R_bc U_r + 7 R_ba [r = 0]
        phase = np.einsum("ac,bc,nr->narb", self.waves[:dim, :dim], pose.rotation, self.basis[self.active])
        phase += 7.0 * np.einsum("ba,r->arb", pose.rotation, first)
        jacobian = np.einsum("ia,na,narb->nirb", pose.rotation, slope, phase)
        return CorrectionField(self.active, self.displacement(rows, pose)[self.active], jacobian)


def make_body(dim):
    mesh = box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], [8, 4, 4][:dim])
    frame = frame_in_box(mesh, "base", [[-1.0] * dim, [0.015] + [1.0] * (dim - 1)])
    handles = place_handles(mesh, 5, [frame])
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0, name="box")


def condensed_mechanics(body):
    """In float64, for finite differences; contact is penalty at the surface samples."""
    found = compute_static_condensation(body, None, NullSpaceCompliance(body))
    modes, weight = found.modes.astype(float), found.weight.astype(float)
    return BodyMechanics(None, replace(found, modes=modes, weight=weight))


def step_energy(dim, corrected, condensed, refinement, monkeypatch, kinematic=(), sharp=False):
    """The `StepEnergy` of a step of a rotated, strained, moving body that a ball slides along, or a box with sharp
    edges; and a point near its start, where friction is lagged."""
    body = make_body(dim)
    gravity = [0.0] * (dim - 1) + [-9.81]
    rng = np.random.default_rng(dim)
    ball = Box([0.02] * dim, name="ball") if sharp else Sphere(0.03, dim, "ball")
    begin = RigidPose.from_rotation_vector([0.3] if dim == 2 else [0.3, 0.1, 0.2], [0.07, 0.072, 0.02][:dim])
    end = RigidPose(begin.rotation, begin.translation + 0.002 * np.eye(dim)[0])
    target = KeyframedPath([0.0], [[0.12, 0.02, 0.03][:dim]], [[0.5] if dim == 2 else [0.5, 0.2, 0.1]])
    simulator = Simulator(
        body,
        [
            PlacedCollider("ball", ball, None, WavyCorrection(1e-3) if corrected else None),
            PlacedCollider("other", ball, None, WavyCorrection(5e-4) if corrected else None),
        ],
        contact=PenaltyContact(1e8, refinement),
        friction=CoulombFriction(0.4, slip_velocity=0.1),
        gravity=gravity,
        springs=[HandleSpring("base", 50.0, target, rotation_stiffness=0.3), HandleSpring(2, 80.0, target)],
        kinematic=kinematic,
        settings=DynamicsSettings(TIME_STEP),
        mechanics=condensed_mechanics(body) if condensed else None,
    )
    caught = []

    def catch(problem, start, newton, sliding):
        caught.extend([problem, start, sliding])
        raise StopIteration

    monkeypatch.setattr(held_hardening, "solve_step", catch)
    below = RigidPose(begin.rotation, begin.translation * [1.0, -0.3, 1.0][:dim])
    state = simulator.rest_state(poses={"ball": begin, "other": below})
    rows = body.handles.retract(state.rows, 2e-3 * rng.normal(size=body.n_dofs))
    state = replace(state, rows=body.handles.retract(state.rows, 5e-3 * rng.normal(size=body.n_dofs)))
    with pytest.raises(StopIteration):
        simulator.step(state, poses={"ball": end, "other": below})
    problem, start, sliding = caught
    body_there = start.body.near(Configuration(rows, start.body.at.poses))
    lagged = problem.lag(problem.point(body_there), sliding.slip)  # it slips by up to 2 mm
    problem = replace(problem, lagged=lagged)
    return problem, problem.point(body_there), rng


def differences(problem, x, function, directions, step):
    """Central differences of `function` along the tangent directions (k, n)."""
    return np.array(
        [
            (function(problem.retract(x, step * d)) - function(problem.retract(x, -step * d))) / (2 * step)
            for d in directions
        ]
    )


@dims
@kinds
@subspaces
@points
def test_gradient_is_the_derivative_of_the_energy(dim, corrected, condensed, refinement, sharp, monkeypatch):
    problem, x, rng = step_energy(dim, corrected, condensed, refinement, monkeypatch, sharp=sharp)
    at = problem.linearise(x)
    contact, friction, _ = x.contacts()
    assert contact > 0
    assert friction > 0  # all terms take part
    slides = x.body.surface.sharp.friction_energy(problem.lagged) > 0
    assert slides == sharp
    assert at.energy == pytest.approx(problem.energy(x), rel=1e-12)  # the same sums in another order
    directions = rng.normal(size=(12, len(at.gradient)))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # Step 1e-6 m on features of 1e-3 m (slip, depth): truncation (1e-3)^2; measured 1e-7 at most.
    numeric = differences(problem, x, problem.energy, directions, 1e-6)
    np.testing.assert_allclose(directions @ at.gradient, numeric, rtol=1e-5, atol=1e-6 * at.scale)


@dims
@subspaces
@points
def test_hessian_without_corrections_is_the_derivative_of_the_gradient(
    dim, condensed, refinement, sharp, monkeypatch
):
    problem, x, rng = step_energy(dim, False, condensed, refinement, monkeypatch, sharp=sharp)
    at = problem.linearise(x)
    # With static condensation the elastic part is in single precision.
    symmetric = 1e-6 if condensed else 1e-10
    np.testing.assert_allclose(at.hessian, at.hessian.T, atol=symmetric * np.abs(at.hessian).max())
    # Second differences of the energy along retractions from one point: the gradient at another point is in
    # other tangent coordinates. Step 3e-5: truncation (3e-5/1e-3)^2 ~ 1e-3 of the contact's share, noise
    # 1e-15 E/1e-9.
    step = 3e-5
    for _ in range(8):
        d = rng.normal(size=len(at.gradient))
        d /= np.linalg.norm(d)
        e = [problem.energy(problem.retract(x, k * step * d)) for k in (-2, -1, 0, 1, 2)]
        numeric = (-e[0] + 16 * e[1] - 30 * e[2] + 16 * e[3] - e[4]) / (12 * step**2)
        assert d @ at.hessian @ d == pytest.approx(numeric, rel=1e-4)


@dims
def test_kinematic_handles_are_not_unknowns(dim, monkeypatch):
    problem, x, _ = step_energy(
        dim, True, False, 0, monkeypatch, kinematic=[KinematicHandle("base"), KinematicHandle(1)]
    )
    at = problem.linearise(x)
    assert at.gradient.shape == (4 * dim,)
    rows, moved = x.body.at.rows, problem.retract(x, np.ones(4 * dim)).body.at.rows
    np.testing.assert_array_equal(moved[5:], rows[5:])
    np.testing.assert_array_equal(moved[1], rows[1])
    assert (moved[[0, 2, 3, 4]] != rows[[0, 2, 3, 4]]).all()


@dims
def test_energy_and_step_are_invariant_to_rigid_motions(dim, monkeypatch):
    """Without gravity and springs, a step is equivariant to a rigid motion of everything."""
    body = make_body(dim)
    motion = RigidPose.from_rotation_vector([0.7] if dim == 2 else [0.7, -0.4, 1.1], [0.3, -0.2, 0.5][:dim])
    ball, correction = Sphere(0.03, dim, "ball"), WavyCorrection(1e-3)
    simulator = Simulator(
        body,
        [PlacedCollider("ball", ball, None, correction)],
        contact=PenaltyContact(1e8),
        friction=CoulombFriction(0.4, 0.1),
    )
    begin = RigidPose(np.eye(dim), np.array([0.07, 0.075, 0.02])[:dim])
    end = RigidPose(np.eye(dim), begin.translation - 0.002)
    state = simulator.rest_state(poses={"ball": begin})
    rows = np.vstack([motion.apply(state.rows[:5]), state.rows[5:-1] @ motion.rotation.T, motion.translation])
    moved = type(state)(0.0, rows, np.zeros_like(rows), {"ball": motion.compose(begin)})
    here = simulator.step(state, {"ball": end})
    there = simulator.step(moved, {"ball": motion.compose(end)})
    assert here.converged
    assert there.converged
    # Both are converged to 1e-4 of the force; round-off alone makes their iterations differ, far below that.
    np.testing.assert_allclose(
        simulator.positions(there.state), motion.apply(simulator.positions(here.state)), atol=1e-8
    )
    force = here.contacts["ball"].force
    np.testing.assert_allclose(
        there.contacts["ball"].force, motion.rotation @ force, atol=1e-4 * np.linalg.norm(force)
    )
