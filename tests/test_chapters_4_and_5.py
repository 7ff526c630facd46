"""The scripts of chapters 4 and 5: what they compute beside the models that they compare."""

from __future__ import annotations

import numpy as np
import pytest

from reproduction.floater_fall import passage
from reproduction.object_centric import Interaction, gradients
from softprint.runtime.body.rotations import rotation_exponential
from softprint.runtime.colliders.pose import RigidPose


@pytest.fixture(params=["jelly2d_body", "jelly3d_body"])
def body(request):
    return request.getfixturevalue(request.param)


def motion(dim: int) -> RigidPose:
    turn = np.full(1 if dim == 2 else 3, 0.4)
    return RigidPose(rotation_exponential(turn), np.linspace(0.01, 0.03, dim))


def moved(body, rows, pose: RigidPose) -> np.ndarray:
    """Handle rows of the body moved rigidly."""
    return rows @ pose.rotation.T + np.outer(body.handles.affine_part, pose.translation)


def test_what_the_object_centric_network_reads_is_relative_to_the_body(body):
    """So it learns nothing about where in the world the two are."""
    rng = np.random.default_rng(0)
    rows = body.rest_rows.copy()
    rows[: body.handles.n_points] += 0.003 * rng.standard_normal((body.handles.n_points, body.dim))
    whole, place = motion(body.dim), RigidPose(motion(body.dim).rotation, np.full(body.dim, 0.05))
    read = Interaction(body)
    before, after = read(rows, place), read(moved(body, rows, whole), whole.compose(place))
    np.testing.assert_allclose(after, before, atol=1e-12)  # m, and entries of a rotation
    assert np.abs(read(rows, RigidPose(place.rotation, place.translation + 0.01)) - before).max() > 1e-3


def test_the_gradient_that_corrections_are_mapped_by_is_that_of_the_motion(body):
    """Of a rigid one: its rotation at every node, to the precision of the basis."""
    whole = motion(body.dim)
    F = gradients(body, moved(body, body.rest_rows, whole))
    np.testing.assert_allclose(F, np.broadcast_to(whole.rotation, F.shape), atol=1e-6)


def test_a_passage_is_found_between_two_frames():
    times = np.array([0.0, 0.1, 0.2, 0.3])
    assert passage(times, np.array([0.02, 0.01, -0.01, -0.05])) == pytest.approx(0.15)
    assert passage(times, np.array([0.02, 0.01, 0.005, 0.001])) is None
    assert passage(times, np.array([-0.02, 0.01, 0.005, 0.001])) == 0.0
