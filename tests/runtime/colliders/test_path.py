"""Keyframed paths: they interpolate keyframes, are constant beyond the ends, C1 without overshoot; and refusals."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp

from softprint.runtime.colliders.path import KeyframedPath, KeyframedPaths
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError

TIMES = [0.0, 0.5, 2.0]


def some_path(dim: int) -> KeyframedPath:
    rng = np.random.default_rng(5)
    return KeyframedPath(TIMES, rng.normal(size=(3, dim)), rng.normal(size=(3, 1 if dim == 2 else 3)))


@pytest.mark.parametrize("dim", [2, 3])
def test_keyframes_are_interpolated_and_ends_are_constant(dim):
    path = some_path(dim)
    for time, position, rotation in zip(TIMES, path.positions, path.rotation_vectors, strict=True):
        expected = RigidPose.from_rotation_vector(rotation, position)
        np.testing.assert_allclose(path.pose(time).matrix, expected.matrix, atol=1e-14)  # round-off
    np.testing.assert_array_equal(path.pose(-3.0).matrix, path.pose(0.0).matrix)
    np.testing.assert_array_equal(path.pose(9.0).matrix, path.pose(2.0).matrix)
    assert path.duration == 2.0


@pytest.mark.parametrize("dim", [2, 3])
def test_positions_are_c1_across_a_keyframe(dim):
    path, e = some_path(dim), 1e-6
    before = (path.pose(0.5).translation - path.pose(0.5 - e).translation) / e
    after = (path.pose(0.5 + e).translation - path.pose(0.5).translation) / e
    np.testing.assert_allclose(before, after, atol=1e-3)  # one-sided differences: second derivative times e


def test_positions_do_not_overshoot():
    path = KeyframedPath([0, 1, 2, 3], [[0, 1.0], [0, 0.2], [0, 0.2], [0, 1.0]])
    heights = [path.pose(t).translation[1] for t in np.linspace(0, 3, 61)]
    assert min(heights) >= 0.2 - 1e-15


def test_slerp_rotates_at_constant_rate_about_one_axis():
    path = KeyframedPath([0, 1], np.zeros((2, 3)), [[0, 0, 0], [0, 0, 1.2]])
    np.testing.assert_allclose(path.pose(0.25).rotation_vector, [0, 0, 0.3], atol=1e-14)


def test_between_keyframes_it_is_the_shortest_arc_and_the_monotone_cubic():
    """Against scipy's."""
    path = some_path(3)
    arc = Slerp(TIMES, Rotation.from_rotvec(path.rotation_vectors))
    cubic = PchipInterpolator(TIMES, path.positions)
    for time in [0.0, 0.2, 0.5, 0.51, 1.7, 2.0]:
        np.testing.assert_allclose(path.pose(time).rotation, arc(time).as_matrix(), atol=1e-14)  # round-off
        np.testing.assert_allclose(path.pose(time).translation, cubic(time), atol=1e-14)


def test_whole_turns_are_kept_in_2d():
    path = KeyframedPath([0, 1], np.zeros((2, 2)), [0.0, 4 * np.pi])
    np.testing.assert_allclose(path.pose(0.5).rotation, np.eye(2), atol=1e-12)  # one full rotation
    assert path.pose(0.25).rotation[0, 0] < 0.99


def test_constant_path():
    pose = RigidPose.from_rotation_vector([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(KeyframedPath.constant(pose).pose(7.0).matrix, pose.matrix, atol=1e-14)


@pytest.mark.parametrize(
    ("times", "positions", "rotations", "message"),
    [
        ([0, 0], [[0, 0], [1, 1]], None, "increase strictly"),
        ([0, 1], [[0, 0]], None, "positions of shape"),
        ([0], [[0, 0, 0]], [[1.0]], "three numbers"),
        ([0, 1], [[0, 0], [np.nan, 1]], None, "finite"),
        ([], np.zeros((0, 2)), None, "at least one"),
    ],
)
def test_refusals(times, positions, rotations, message):
    with pytest.raises(SoftprintError, match=message):
        KeyframedPath(times, positions, rotations)


@pytest.mark.parametrize("dim", [2, 3])
def test_paths_together_agree_with_single_paths(dim):
    """With equal times, as in a recorded motion, and mixed with a constant path."""
    rng = np.random.default_rng(6)
    spin = 1 if dim == 2 else 3
    alike = [KeyframedPath(TIMES, rng.normal(size=(3, dim)), rng.normal(size=(3, spin))) for _ in range(4)]
    for paths in (alike, [*alike, KeyframedPath([1.0], rng.normal(size=(1, dim)))]):
        for time in (-1.0, 0.0, 0.3, 0.5, 1.7, 2.0, 3.0):
            rotations, positions = KeyframedPaths(paths).poses(time)
            for path, rotation, position in zip(paths, rotations, positions, strict=True):
                pose = path.pose(time)
                # Round-off of a product of rotations.
                np.testing.assert_allclose(rotation, pose.rotation, atol=1e-14)
                np.testing.assert_allclose(position, pose.translation, atol=1e-14)
