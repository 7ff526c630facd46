"""Friction: Coulomb's law in its limits, finite differences, and invariance to the collider's own motion."""

import dataclasses

import numpy as np
import pytest

from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.errors import SoftprintError

FRICTION = CoulombFriction(coefficient=0.4, slip_velocity=0.1)
TIME_STEP = 0.02  # eps = slip_velocity * time_step = 2 mm
EPS = 2e-3


def scene(dim: int):
    """Displaced points on a sphere, some by less and some by more than EPS; the sphere has moved too."""
    rng = np.random.default_rng(8)
    vector = rng.normal(size=1 if dim == 2 else 3)
    start_pose = RigidPose.from_rotation_vector(vector, rng.normal(size=dim))
    end_pose = RigidPose.from_rotation_vector(vector + 0.05, start_pose.translation + 0.02)
    z = rng.normal(size=(20, dim))
    z *= 0.28 / np.linalg.norm(z, axis=1, keepdims=True)
    start = start_pose.apply(z)
    x = end_pose.apply(z) + EPS * rng.uniform(-1.5, 1.5, (20, dim))
    contact = PenaltyContact(1e7).terms(x, np.full(20, 1e-3), Sphere(0.3, dim), end_pose)
    return x, start, contact, start_pose, end_pose


dims = pytest.mark.parametrize("dim", [2, 3])


@dims
def test_gradient_and_hessian_by_finite_differences(dim):
    x, start, contact, start_pose, end_pose = scene(dim)
    lagged = FRICTION.lag(contact, start, start_pose, end_pose)
    terms = FRICTION.terms(x, lagged, TIME_STEP)
    step = 1e-7  # against EPS = 2e-3: truncation (step / EPS)^2 ~ 3e-9, cancellation 1e-16 / 1e-7 ~ 1e-9
    for j in range(dim):
        e = step * np.eye(dim)[j]
        forward, backward = FRICTION.terms(x + e, lagged, TIME_STEP), FRICTION.terms(x - e, lagged, TIME_STEP)
        slope = (forward.energy - backward.energy) / (2 * step)
        np.testing.assert_allclose(
            terms.gradient[:, j].sum(), slope, atol=1e-6 * np.abs(terms.gradient).sum()
        )
        column = (forward.gradient - backward.gradient) / (2 * step)
        np.testing.assert_allclose(terms.hessian[:, :, j], column, atol=1e-5 * np.abs(terms.hessian).max())


@dims
def test_hessian_is_positive_semi_definite(dim):
    x, start, contact, start_pose, end_pose = scene(dim)
    terms = FRICTION.terms(x, FRICTION.lag(contact, start, start_pose, end_pose), TIME_STEP)
    eigenvalues = np.linalg.eigvalsh(terms.hessian)
    assert eigenvalues.min() > -1e-12 * eigenvalues.max()  # round-off


@dims
def test_friction_on_a_sliding_point_is_mu_times_the_normal_force(dim):
    x, start, contact, start_pose, end_pose = scene(dim)
    lagged = FRICTION.lag(contact, start, start_pose, end_pose)
    away = np.zeros_like(lagged.normal)
    away[:, 0], away[:, 1] = -lagged.normal[:, 1], lagged.normal[:, 0]  # tangential
    x = x.copy()
    x[lagged.index] = lagged.anchor + away / np.linalg.norm(away, axis=1, keepdims=True) * 5 * EPS
    terms = FRICTION.terms(x, lagged, TIME_STEP)
    np.testing.assert_allclose(np.linalg.norm(terms.gradient, axis=1), 0.4 * lagged.force, rtol=1e-12)
    power = ((x[lagged.index] - lagged.anchor) * -terms.gradient).sum(axis=1)
    assert (power < 0).all()  # the force opposes the motion
    normal_part = (terms.gradient * lagged.normal).sum(axis=1)
    np.testing.assert_allclose(normal_part, 0.0, atol=1e-12 * lagged.force.max())  # round-off


@dims
def test_moving_with_the_collider_costs_only_the_constant(dim):
    _x, start, contact, start_pose, end_pose = scene(dim)
    riding = end_pose.apply(start_pose.apply_inverse(start))
    terms = FRICTION.terms(riding, FRICTION.lag(contact, start, start_pose, end_pose), TIME_STEP)
    scale = 0.4 * np.linalg.norm(contact.gradient, axis=1).max()
    np.testing.assert_allclose(terms.gradient, 0.0, atol=1e-10 * scale)  # round-off of positions over EPS
    assert np.isfinite(terms.hessian).all()


@dims
def test_moving_everything_together_rotates_the_force(dim):
    x, start, contact, start_pose, end_pose = scene(dim)
    rng = np.random.default_rng(1)
    motion = RigidPose.from_rotation_vector(rng.normal(size=1 if dim == 2 else 3), rng.normal(size=dim))
    here = FRICTION.terms(x, FRICTION.lag(contact, start, start_pose, end_pose), TIME_STEP)
    moved = dataclasses.replace(
        contact, gradient=motion.rotate(contact.gradient), normal=motion.rotate(contact.normal)
    )
    lagged = FRICTION.lag(moved, motion.apply(start), motion.compose(start_pose), motion.compose(end_pose))
    there = FRICTION.terms(motion.apply(x), lagged, TIME_STEP)
    np.testing.assert_allclose(there.energy, here.energy, rtol=1e-10)
    scale = np.abs(here.gradient).max()
    np.testing.assert_allclose(there.gradient, motion.rotate(here.gradient), atol=1e-10 * scale)


def test_stick_and_slip_meet_smoothly():
    x, start, contact, start_pose, end_pose = scene(2)
    lagged = FRICTION.lag(contact, start, start_pose, end_pose)
    tangent = np.column_stack([-lagged.normal[:, 1], lagged.normal[:, 0]])

    def at(distance: float):
        y = x.copy()
        y[lagged.index] = lagged.anchor + distance * tangent
        return FRICTION.terms(y, lagged, TIME_STEP)

    below, above = at(EPS * (1 - 1e-9)), at(EPS * (1 + 1e-9))
    np.testing.assert_allclose(below.energy, above.energy, rtol=1e-8)
    np.testing.assert_allclose(below.gradient, above.gradient, rtol=1e-8)
    # C2: the tangential stiffness f1' falls to zero on both sides of EPS
    np.testing.assert_allclose(below.hessian, above.hessian, atol=1e-6 * np.abs(at(0.0).hessian).max())


@pytest.mark.parametrize("bad", [{"coefficient": -0.1}, {"coefficient": 0.3, "slip_velocity": 0.0}])
def test_refuses_meaningless_numbers(bad):
    with pytest.raises(SoftprintError):
        CoulombFriction(**bad)
