"""Linear blend skinning: bounded weights that blend rigid frames."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import build_body, frame_in_box, load_body, place_handles, save_body
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.skinning import skinning_basis, skinning_weights
from softprint.runtime.colliders import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import BodySpec
from softprint.runtime.mesh import box_mesh, write_mesh

ROUND_OFF = 1e-12  # of sums of three products of numbers of order one


def skeleton(dim: int, frames: int = 3) -> tuple:
    """A bar with a bone at each end and one in the middle."""
    mesh = box_mesh([0.0] * dim, [0.12, 0.02, 0.02][:dim], [24, 4, 4][:dim])
    spans = [(-1.0, 0.015), (0.055, 0.065), (0.105, 1.0)][:frames]
    bones = [
        frame_in_box(mesh, f"bone_{at}", [[low] + [-1.0] * (dim - 1), [high] + [1.0] * (dim - 1)])
        for at, (low, high) in enumerate(spans)
    ]
    return mesh, place_handles(mesh, 0, bones)


@pytest.mark.parametrize("dim", [2, 3])
def test_weights_are_bounded_sum_to_one_and_own_their_bones(dim):
    mesh, handles = skeleton(dim)
    weights = skinning_weights(mesh, handles)
    assert weights.min() >= 0.0
    assert weights.max() <= 1.0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=ROUND_OFF)
    for at, frame in enumerate(handles.frames):
        np.testing.assert_array_equal(weights[frame.nodes, at], 1.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_affine_maps_are_reproduced(dim):
    mesh, handles = skeleton(dim)
    rng = np.random.default_rng(0)
    map_, shift = rng.normal(size=(dim, dim)), rng.normal(size=dim)
    rows = np.vstack([np.vstack([map_.T, shift])] * len(handles.frames))
    np.testing.assert_allclose(
        skinning_basis(mesh, handles) @ rows, mesh.points @ map_.T + shift, atol=ROUND_OFF
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_a_node_is_the_weighted_mean_of_where_bones_carry_it(dim):
    mesh, handles = skeleton(dim)
    angle = 0.7
    turn = np.eye(dim)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    poses = [
        RigidPose(np.eye(dim), np.zeros(dim)),
        RigidPose(turn, np.full(dim, 0.01)),
        RigidPose(turn @ turn, np.full(dim, -0.02)),
    ]
    rows = handles.rest_rows(mesh.points)
    for frame, pose in zip(handles.frames, poses, strict=True):
        rows = handles.with_frame(rows, frame.name, pose.rotation, pose.translation)
    weights = skinning_weights(mesh, handles)
    carried = np.stack([mesh.points @ pose.rotation.T + pose.translation for pose in poses], axis=1)
    np.testing.assert_allclose(
        skinning_basis(mesh, handles) @ rows, (weights[:, :, None] * carried).sum(axis=1), atol=ROUND_OFF
    )


def test_weights_of_a_bar_are_symmetric_and_fall_from_one_bone_to_the_next():
    """Between two bones of a bar there is nothing else to follow. The cells of a box mesh are not symmetric."""
    mesh, handles = skeleton(2)
    weights = skinning_weights(mesh, handles)
    along = np.argsort(mesh.points[:, 0], kind="stable")
    x, first = mesh.points[along, 0], weights[along, 0]
    between = (x > 0.015) & (x < 0.055)
    middle = [first[between & np.isclose(x, at)].mean() for at in np.unique(np.round(x[between], 9))]
    assert (np.diff(middle) < 0).all()
    # A quarter and three quarters of the way: their weights add up to that of the ends, within the mesh's asymmetry.
    assert middle[0] + middle[-1] == pytest.approx(1.0, abs=0.05)
    assert weights[along, 2][x < 0.05].max() < 0.05


def test_one_bone_carries_everything():
    mesh, handles = skeleton(3, frames=1)
    np.testing.assert_array_equal(skinning_weights(mesh, handles), 1.0)


def test_points_are_refused_and_frames_must_not_overlap():
    mesh, handles = skeleton(2)
    with pytest.raises(SoftprintError, match="points = 0"):
        skinning_basis(mesh, Handles(2, np.array([60]), handles.frames))
    twice = Handles(2, np.empty(0, dtype=np.int64), (handles.frames[0], handles.frames[0]))
    with pytest.raises(SoftprintError, match="share a node"):
        skinning_basis(mesh, twice)


def test_an_experiment_asks_for_it(tmp_path):
    mesh, _ = skeleton(2)
    write_mesh(tmp_path / "bar.vtu", mesh)
    table = {
        "mesh": "bar.vtu",
        "handles": {
            "points": 0,
            "subspace": "linear_blend_skinning",
            "frames": [
                {"name": "left", "box": [[-1, -1], [0.015, 1]]},
                {"name": "right", "box": [[0.105, -1], [1, 1]]},
            ],
        },
        "material": {"young": 2e4, "poisson": 0.4},
    }
    body = build_body(BodySpec.model_validate(table), tmp_path)
    assert body.basis.min() >= -ROUND_OFF  # this bar lies in x, y >= 0
    biharmonic = table | {"handles": table["handles"] | {"subspace": "biharmonic_coordinates"}}
    other = build_body(BodySpec.model_validate(biharmonic), tmp_path)
    assert other.basis.min() < -1e-3
    # Truth and corrections of one are refused by the other, and the kind survives the file.
    assert other.content_hash != body.content_hash
    save_body(tmp_path / "body.h5", body)
    again = load_body(tmp_path / "body.h5")
    assert again.subspace == "linear_blend_skinning"
    assert again.content_hash == body.content_hash
    moved = body.handles.with_frame(body.rest_rows, "right", np.eye(2), np.array([0.01, 0.0]))
    stretched = body.reduced_positions(moved)
    # The mesh file rounds to single precision.
    assert np.ptp(stretched[:, 0]) == pytest.approx(0.13, abs=1e-8)
