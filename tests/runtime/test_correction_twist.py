"""What a twist of the collider makes of a correction: against finite differences of its pose, and against what a common
motion of body and collider leaves as it is."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.body import ReducedBody
from runtime.body.rotations import rotation_exponential
from runtime.colliders import Box, RigidPose
from runtime.learned.thesis6.correction import BoundDescriptorCorrection, DescriptorCorrection
from runtime.learned.thesis6.descriptors import DirectGeometry, GridGeometry
from runtime.learned.thesis6.model import DescriptorModel, DescriptorModelOptions
from runtime.rigid.twist import twist_size
from tests.runtime.test_corrections import (
    DIFFERENCES,
    FIELDS,
    bent_rows,
    make_correction,
    pressed_pose,
    random_weights,
)

RADIUS, SETS = 0.03, 8


def twisted(pose: RigidPose, twist: np.ndarray, centre: np.ndarray) -> RigidPose:
    """Moved by a twist (s, w) about the centre c: R' = exp([w]) R, and c goes to c + s."""
    turn = rotation_exponential(twist[pose.dim :])
    place = centre + twist[: pose.dim] + turn @ (pose.translation - centre)
    return RigidPose(turn @ pose.rotation, place)


def require_true_by_twist(bound, body: ReducedBody, rows: np.ndarray, pose: RigidPose) -> None:
    """By every number of the twist, at all points, those that are inactive among them."""
    centre, step = np.linspace(-0.02, 0.05, body.dim), 1e-6
    field = bound.linearise(rows, pose)
    assert np.abs(field.displacement).max() > 1e-5
    n = len(body.mesh.points)
    assert 0 < len(field.index) < n
    by_hand = np.zeros((n, body.dim, twist_size(body.dim)))
    by_hand[field.index] = field.by_twist(rows, body.handles.affine_part, centre)
    for number, twist in enumerate(step * np.eye(twist_size(body.dim))):
        ahead, back = (bound.displacement(rows, twisted(pose, way * twist, centre)) for way in (1, -1))
        error = np.abs((ahead - back) / (2 * step) - by_hand[:, :, number]).max()
        assert error < DIFFERENCES * max(np.abs(by_hand).max(), 1.0)


@pytest.mark.parametrize("form", FIELDS)
def test_by_twist_is_the_derivative_by_the_pose(form, jelly_body):
    bound = make_correction(form, jelly_body, {}).bind(jelly_body.node_points(), reach=0.025)
    require_true_by_twist(bound, jelly_body, bent_rows(jelly_body), pressed_pose(jelly_body))


def descriptor_of_a_box(body: ReducedBody, kind: str) -> BoundDescriptorCorrection:
    """A box has an edge to turn the frames of a descriptor, and no axis of symmetry."""
    box = Box([0.02, 0.015, 0.01][: body.dim], 0.003, "box")
    model = DescriptorModel(
        DescriptorModelOptions((16, 12), "elu", RADIUS, SETS, "all", 5e-4), body.dim, body.n_rows
    )
    random_weights(model, 3)
    model.scale.fill_(0.03)
    model.output_scale.fill_(1e-3)
    geometry = (DirectGeometry if kind == "direct" else GridGeometry)(box, RADIUS, SETS)
    return DescriptorCorrection("x", model.double(), body, box, geometry).bind(body.node_points())


@pytest.mark.parametrize("kind", ["direct", "grid"])
def test_by_twist_goes_through_distance_frame_and_descriptor(kind, jelly_body):
    body = jelly_body
    bound, rows, pose = descriptor_of_a_box(body, kind), bent_rows(body), pressed_pose(body)
    require_true_by_twist(bound, body, rows, pose)


@pytest.mark.parametrize("form", FIELDS)
def test_a_common_translation_changes_nothing(form, jelly_body):
    """Derivatives by rows and by the twist cancel along it, as what they are derivatives of does not move."""
    body, rows, pose = jelly_body, bent_rows(jelly_body), pressed_pose(jelly_body)
    bound = make_correction(form, body, {}).bind(body.node_points())
    field, along = bound.linearise(rows, pose), np.linspace(0.3, 1.0, body.dim)
    moved = body.handles.affine_part[:, None] * along
    through_rows = np.einsum("narb,rb->na", field.jacobian, moved)
    through_pose = (
        field.by_twist(rows, body.handles.affine_part, np.zeros(body.dim))[:, :, : body.dim] @ along
    )
    assert np.abs(through_pose).max() > 1e-3
    # Sums over tens of rows of numbers of order one.
    assert np.allclose(through_rows, -through_pose, atol=1e-13)
    common = RigidPose(pose.rotation, pose.translation + along)
    # Round-off of coordinates of a metre, amplified by the network.
    assert np.allclose(bound.displacement(rows + moved, common), bound.displacement(rows, pose), atol=1e-12)
