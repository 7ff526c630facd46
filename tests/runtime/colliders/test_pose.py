"""Rigid poses: group laws, agreement with homogeneous matrices, and refusals."""

import numpy as np
import pytest

from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError

ROUND_OFF = 1e-14  # a handful of products of numbers of order one

pytestmark = pytest.mark.parametrize("dim", [2, 3])


def some_pose(dim: int, seed: int) -> RigidPose:
    rng = np.random.default_rng(seed)
    return RigidPose.from_rotation_vector(rng.normal(size=1 if dim == 2 else 3), rng.normal(size=dim))


def test_apply_is_the_homogeneous_matrix(dim):
    pose, points = some_pose(dim, 1), np.random.default_rng(2).normal(size=(5, dim))
    homogeneous = np.c_[points, np.ones(5)] @ pose.matrix.T
    np.testing.assert_allclose(pose.apply(points), homogeneous[:, :dim], atol=ROUND_OFF)


def test_inverse_undoes_and_compose_chains(dim):
    first, second = some_pose(dim, 1), some_pose(dim, 2)
    points = np.random.default_rng(3).normal(size=(5, dim))
    np.testing.assert_allclose(first.apply_inverse(first.apply(points)), points, atol=ROUND_OFF)
    np.testing.assert_allclose(first.inverse().apply(points), first.apply_inverse(points), atol=ROUND_OFF)
    chained = second.compose(first).apply(points)
    np.testing.assert_allclose(chained, second.apply(first.apply(points)), atol=ROUND_OFF)


def test_vectors_and_tensors_rotate_without_translation(dim):
    pose, v = some_pose(dim, 1), np.random.default_rng(4).normal(size=(5, dim))
    moved = pose.rotate(v)
    np.testing.assert_allclose(moved, pose.apply(v) - pose.translation, atol=ROUND_OFF)
    np.testing.assert_allclose(pose.rotate_inverse(moved), v, atol=ROUND_OFF)
    outer = pose.rotate_matrices(v[:, :, None] * v[:, None, :])
    np.testing.assert_allclose(outer, moved[:, :, None] * moved[:, None, :], atol=ROUND_OFF)


def test_rotation_vector_round_trip(dim):
    pose = some_pose(dim, 1)
    again = RigidPose.from_rotation_vector(pose.rotation_vector, pose.translation)
    np.testing.assert_allclose(again.matrix, pose.matrix, atol=ROUND_OFF)


def test_refuses_what_is_not_rigid(dim):
    reflection = np.diag([-1.0] + [1.0] * (dim - 1))
    for rotation in (reflection, 2 * np.eye(dim), np.full((dim, dim), np.nan)):
        with pytest.raises(SoftprintError, match="not a rigid pose"):
            RigidPose(rotation, np.zeros(dim))
    with pytest.raises(SoftprintError, match="shapes"):
        RigidPose(np.eye(dim), np.zeros(dim + 1))


def test_is_not_changed_through_the_callers_arrays(dim):
    translation = np.zeros(dim)
    pose = RigidPose(np.eye(dim), translation)
    translation[0] = 1.0
    assert pose.translation[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        pose.translation[0] = 1.0
