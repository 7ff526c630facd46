"""Penalty contact: a hand calculation, finite differences of every derivative, and invariances."""

import numpy as np
import pytest

from softprint.runtime.colliders import Box, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.errors import SoftprintError

CONTACT = PenaltyContact(stiffness=1e6)
STEP = 1e-6  # central differences: truncation ~ STEP^2, cancellation ~ 1e-16 / STEP, both far below 1e-6
RELATIVE = 1e-6


def scene(dim: int, kind: str):
    rng = np.random.default_rng(11)
    collider = Sphere(0.3, dim) if kind == "sphere" else Box([0.3, 0.25, 0.2][:dim], rounding=0.08)
    pose = RigidPose.from_rotation_vector(rng.normal(size=1 if dim == 2 else 3), rng.normal(size=dim))
    x = pose.apply(rng.uniform(-0.4, 0.4, (60, dim)))
    return x, rng.uniform(0.5, 1.5, 60), collider, pose


cases = pytest.mark.parametrize(("dim", "kind"), [(d, k) for d in (2, 3) for k in ("sphere", "box")])


def test_one_point_in_a_circle_by_hand():
    terms = CONTACT.terms(
        np.array([[0.2, 0.0], [0.5, 0.0]]), np.array([2.0, 1.0]), Sphere(0.3, 2), RigidPose.identity(2)
    )
    depth = 0.3 - 0.2
    assert terms.index.tolist() == [0]
    np.testing.assert_allclose(terms.depth, [depth])
    np.testing.assert_allclose(terms.energy, 2.0 * 1e6 / 3 * depth**3)
    np.testing.assert_allclose(terms.gradient, [[-2.0 * 1e6 * depth**2, 0.0]], atol=1e-9)  # pushed outwards
    # radial: 2 a k depth; tangential: -a k depth^2 / |z|, the curvature of the circle through the point
    np.testing.assert_allclose(terms.hessian[0], np.diag([2 * 2e6 * depth, -2e6 * depth**2 / 0.2]), atol=1e-6)


@cases
def test_gradient_and_hessian_by_finite_differences(dim, kind):
    x, areas, collider, pose = scene(dim, kind)
    terms = CONTACT.terms(x, areas, collider, pose)
    assert 5 < terms.index.size < len(x)
    for j in range(dim):
        # points are independent: shift all at once and difference each one's own force
        step = STEP * np.eye(dim)[j]
        forward = CONTACT.terms(x[terms.index] + step, areas[terms.index], collider, pose)
        backward = CONTACT.terms(x[terms.index] - step, areas[terms.index], collider, pose)
        slope = (forward.energy - backward.energy) / (2 * STEP)
        np.testing.assert_allclose(terms.gradient[:, j].sum(), slope, rtol=RELATIVE, atol=1e-4)
        column = (forward.gradient - backward.gradient) / (2 * STEP)
        scale = np.abs(terms.hessian).max()
        np.testing.assert_allclose(terms.hessian[:, :, j], column, atol=RELATIVE * scale)


@cases
def test_each_points_gradient_is_the_slope_of_its_energy(dim, kind):
    x, areas, collider, pose = scene(dim, kind)
    terms = CONTACT.terms(x, areas, collider, pose)
    i = terms.index[np.argmax(terms.depth)]
    for j in range(dim):
        step = np.zeros_like(x)
        step[i, j] = STEP
        slope = CONTACT.energy(x + step, areas, collider, pose) - CONTACT.energy(
            x - step, areas, collider, pose
        )
        expected = terms.gradient[np.argmax(terms.depth), j]
        np.testing.assert_allclose(slope / (2 * STEP), expected, atol=RELATIVE * np.abs(terms.gradient).max())


@cases
def test_moving_body_and_collider_together(dim, kind):
    x, areas, collider, pose = scene(dim, kind)
    rng = np.random.default_rng(3)
    motion = RigidPose.from_rotation_vector(rng.normal(size=1 if dim == 2 else 3), rng.normal(size=dim))
    here = CONTACT.terms(x, areas, collider, pose)
    there = CONTACT.terms(motion.apply(x), areas, collider, motion.compose(pose))
    scale = np.abs(here.hessian).max()
    np.testing.assert_allclose(
        there.energy, here.energy, rtol=1e-12
    )  # coordinates of order one, to round-off
    np.testing.assert_allclose(there.gradient, motion.rotate(here.gradient), atol=1e-12 * scale)
    np.testing.assert_allclose(there.hessian, motion.rotate_matrices(here.hessian), atol=1e-11 * scale)


def test_energy_alone_is_that_of_the_terms():
    x, areas, collider, pose = scene(3, "box")
    assert CONTACT.energy(x, areas, collider, pose) == pytest.approx(
        CONTACT.terms(x, areas, collider, pose).energy, rel=1e-14
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_no_contact_is_empty(dim):
    terms = CONTACT.terms(np.full((4, dim), 5.0), np.ones(4), Sphere(0.3, dim), RigidPose.identity(dim))
    assert terms.energy == 0
    assert terms.index.size == 0
    assert terms.gradient.shape == (0, dim)
    assert terms.hessian.shape == (0, dim, dim)


@pytest.mark.parametrize("stiffness", [0.0, -1.0, np.nan, np.inf])
def test_refuses_a_meaningless_stiffness(stiffness):
    with pytest.raises(SoftprintError, match="stiffness"):
        PenaltyContact(stiffness)


@pytest.mark.parametrize("refinement", [-1, 1.5, 1000])
def test_refuses_a_meaningless_refinement(refinement):
    with pytest.raises(SoftprintError, match="a whole number from 0 to 64"):
        PenaltyContact(1e9, refinement)
