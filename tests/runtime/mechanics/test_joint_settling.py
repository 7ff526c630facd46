"""What bent joints settle beyond static condensation: joints, angles, and a displacement that rotates with the body."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.body.rotations import rotation_exponential
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.joint_settling import Joints, JointSettling, kernel
from tests.bent_beam import beam_with_joints, bent

STATES = 5


@pytest.fixture(scope="module", params=[2, 3], ids=["2d", "3d"])
def beam(request):
    return beam_with_joints(request.param)


def settling(body):
    rng, joints = np.random.default_rng(0), Joints.of(body)
    angles = 0.5 * rng.normal(size=(STATES, 2, 1 if body.dim == 2 else 3))
    return JointSettling(joints, angles, 1e-3 * rng.normal(size=(body.n_nodes, body.dim, STATES)))


def test_joints_are_between_neighbours(beam):
    assert sorted(map(tuple, Joints.of(beam).pairs)) == [(0, 1), (0, 2)]


def test_a_body_with_one_frame_has_none(jelly_body):
    assert not len(Joints.of(jelly_body).pairs)


def test_angles_are_those_between_the_frames(beam):
    joints = Joints.of(beam)
    found = joints.angles(bent(beam, 0.3, 0.7, -0.2))[:, -1]
    expected = {(0, 1): 0.4, (0, 2): -0.5}
    # Round-off.
    np.testing.assert_allclose(found, [expected[tuple(pair)] for pair in joints.pairs], atol=1e-12)
    np.testing.assert_allclose(joints.angles(beam.rest_rows), 0.0, atol=1e-12)


def test_the_kernel_is_that_of_polynomials(beam):
    """Of first and second order in the angles of each joint."""
    theta, others = np.random.default_rng(1).normal(size=(2, 4, 3, 3))
    linear = np.einsum("njk,mjk->nm", theta, others)
    square = np.einsum("njk,njl,mjk,mjl->nm", theta, theta, others, others)
    np.testing.assert_allclose(kernel(theta, others), linear + square, rtol=1e-12)


def test_it_rotates_with_the_body_and_is_held_in_a_step(beam):
    dim = beam.dim
    condensation = compute_mechanics(beam, 100, condensation=True).condensation
    settled = replace(condensation, settling=settling(beam))
    frame_rows, rows = bent(beam, 0.3, 0.7, -0.2), bent(beam, 0.35, 0.6, -0.3)
    plain, own = condensation.corotated(frame_rows), settled.corotated(frame_rows)
    e = settled.settling.displacement(frame_rows)
    assert np.abs(e).max() > 1e-4
    expected = np.einsum("nab,nb->na", plain.rotations, e)
    for at in (frame_rows, rows):
        np.testing.assert_allclose(own.displacement(at) - plain.displacement(at), expected, atol=1e-12)
    some = np.array([7, 3])
    np.testing.assert_array_equal(own.displacement(rows, some), own.displacement(rows)[some])
    part = settled.at(some).corotated(frame_rows)
    np.testing.assert_allclose(part.displacement(rows), own.displacement(rows)[some], atol=1e-12)
    np.testing.assert_array_equal(own.jacobian(), plain.jacobian())
    Q = rotation_exponential(np.array([1.1] if dim == 2 else [0.3, -0.8, 1.1]))
    turned = settled.corotated(frame_rows @ Q.T)
    # Gradients of rotations in single precision.
    np.testing.assert_allclose(turned.settled, own.settled @ Q.T, atol=1e-6 * np.abs(e).max())


def test_nothing_settles_at_rest(beam):
    np.testing.assert_allclose(settling(beam).displacement(beam.rest_rows), 0.0, atol=1e-15)
