"""Distances of world points from a posed collider: the compiled query agrees with distance and pose applied one by
one."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.colliders import RigidPose
from softprint.runtime.colliders.library import library_collider
from softprint.runtime.colliders.sampled.polygon import polygon_collider

SIZE = 0.02


@pytest.mark.parametrize("distance", [0.0, 0.1 * SIZE, SIZE])
def test_distances_of_a_grid_agree_with_its_sdf(distance):
    rng = np.random.default_rng(0)
    collider = library_collider("torus", SIZE, resolution=16)
    pose = RigidPose.from_rotation_vector([0.3, -0.5, 0.9], [0.01, -0.02, 0.03])
    z = rng.uniform(-1.5 * SIZE, 1.5 * SIZE, size=(400, 3))
    index, near, value = collider.closer_to(pose.apply(z), pose, distance)
    reach = distance + collider.spacing
    within = np.all((z > collider.lower - reach) & (z < collider.upper + reach), axis=1)
    expected = np.flatnonzero(within & (collider.sdf(z) < distance))
    assert len(expected) > 10
    np.testing.assert_array_equal(index, expected)
    # Round-off of a rotation and its inverse.
    np.testing.assert_allclose(near, z[index], atol=1e-15)
    np.testing.assert_allclose(value, collider.sdf(z[index]), atol=1e-15)


def plate():
    """Thinner than a cell, so that its spline bulges."""
    outline = SIZE * np.array([[-1.0, -0.05], [1.0, -0.05], [1.0, 0.05], [-1.0, 0.05]])
    return polygon_collider(outline, resolution=24)


@pytest.mark.parametrize(
    "make", [lambda: library_collider("mug", SIZE, resolution=16), plate], ids=["3D", "2D"]
)
def test_no_point_inside_is_left_out(make):
    """A spline rounds off edges and thin walls, and so is negative outside the bounds of the solid. A contact that left
    out such points would begin with a jump of the force where they enter the bounds."""
    rng = np.random.default_rng(2)
    collider = make()
    z = rng.uniform(1.2 * collider.lower, 1.2 * collider.upper, size=(200_000, collider.dim))
    inside = np.flatnonzero(collider.sdf(z) < 0.0)
    beyond = np.any((z[inside] < collider.lower) | (z[inside] > collider.upper), axis=1)
    assert beyond.any()
    index, value = collider.closer(z, 0.0)
    np.testing.assert_array_equal(index, inside)
    np.testing.assert_array_equal(value, collider.sdf(z[inside]))
    np.testing.assert_array_equal(collider.closer_to(z, RigidPose.identity(collider.dim), 0.0)[0], inside)


def torus():
    return library_collider("torus", SIZE, resolution=16)


def drop_2d():
    outline = SIZE * np.array([[-0.8, -0.5], [0.7, -0.6], [0.9, 0.3], [0.0, 0.9], [-0.6, 0.4]])
    return polygon_collider(outline, resolution=24)


@pytest.mark.parametrize("spread", [0.6, 4.0], ids=["within its fine grid", "far beyond it"])
@pytest.mark.parametrize(("make", "turned"), [(torus, [0.3, -0.5, 0.9]), (drop_2d, [0.7])], ids=["3D", "2D"])
def test_derivatives_of_a_grid_rotate_with_its_pose(make, turned, spread):
    rng = np.random.default_rng(1)
    collider = make()
    pose = RigidPose.from_rotation_vector(turned, [0.01, -0.02, 0.03][: collider.dim])
    z = rng.uniform(-spread * SIZE, spread * SIZE, size=(100, collider.dim))
    found, local = collider.sdf_derivatives_at(pose.apply(z), pose), collider.sdf_derivatives(z)
    R = pose.rotation
    # Round-off of a rotation and its inverse, times the change of each derivative over a cell.
    np.testing.assert_allclose(found.value, local.value, atol=1e-15)
    np.testing.assert_allclose(found.gradient, local.gradient @ R.T, atol=1e-12)
    np.testing.assert_allclose(found.hessian, R @ local.hessian @ R.T, atol=1e-12 / SIZE)
