"""USD files, read and validated by the library of their makers."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdValidation
from scipy.spatial.transform import Rotation

from softprint.runtime.convert.formats import convert_motion
from softprint.runtime.convert.frames import in_space, pose_in_space, surface_motion
from softprint.runtime.convert.sampling import Sampling
from softprint.runtime.errors import SoftprintError


@pytest.fixture(params=["usda", "usdc", "usdz"])
def stage(request, motion, tmp_path):
    path = tmp_path / f"press.{request.param}"
    convert_motion(motion, path)
    return Usd.Stage.Open(str(path))


def test_the_validators_find_nothing(stage):
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 20
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in found] == []


def test_units_axis_and_time(stage, motion):
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == ("Z" if motion.rest.dim == 3 else "Y")
    assert stage.GetTimeCodesPerSecond() == pytest.approx(50.0)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 15)
    assert stage.GetDefaultPrim().GetPath() == "/World"


def test_every_sample_is_a_frame(stage, motion):
    mesh = UsdGeom.Mesh.Get(stage, "/World/body")
    assert mesh.GetPointsAttr().GetTimeSamples() == list(range(16))
    assert len(mesh.GetFaceVertexIndicesAttr().Get()) == 3 * len(mesh.GetFaceVertexCountsAttr().Get())
    for number, frame in enumerate(surface_motion(motion).frames()):
        points = np.array(mesh.GetPointsAttr().Get(number))
        np.testing.assert_array_equal(points, np.float32(in_space(frame.points)))
        extent = np.array(mesh.GetExtentAttr().Get(number))
        np.testing.assert_array_equal(extent, [points.min(axis=0), points.max(axis=0)])
        assert UsdGeom.Boundable.ComputeExtentFromPlugins(mesh, number) == mesh.GetExtentAttr().Get(number)


def test_between_two_samples_it_is_half_way(stage):
    points = UsdGeom.Mesh.Get(stage, "/World/body").GetPointsAttr()
    middle = 0.5 * (np.array(points.Get(9)) + np.array(points.Get(10)))
    np.testing.assert_allclose(np.array(points.Get(9.5)), middle, atol=1e-8)


def test_colliders_are_rigid_transforms(stage, motion):
    for name, track in motion.colliders.items():
        xform = UsdGeom.Xform.Get(stage, f"/World/{name}")
        for frame in (0, 8, 15):
            seen = np.array(xform.GetLocalTransformation(Usd.TimeCode(frame))).T  # USD's vectors are rows
            np.testing.assert_allclose(seen, pose_in_space(track.poses[frame]).matrix, atol=1e-7)  # float32
        assert stage.GetPrimAtPath(f"/World/{name}/{name}")


def test_rotations_are_those_of_the_poses(tmp_path, jelly3d_body):
    """A collider that turns by a third of a circle about a slanted axis."""
    from softprint import PenaltyContact, PlacedCollider, Recording, RigidPose, Simulator, colliders

    turns = [t * np.array([0.6, -1.2, 0.9]) for t in (0.0, 0.7, 1.4)]
    poses = [RigidPose.from_rotation_vector(turn, [0.1, 0.0, 0.2]) for turn in turns]
    simulator = Simulator(
        jelly3d_body,
        [PlacedCollider("a box!", colliders.Box([0.01, 0.02, 0.03]))],
        contact=PenaltyContact(1e9),
    )
    recording = Recording(simulator)
    for k, pose in enumerate(poses):
        recording.add(simulator.rest_state(0.1 * k, {"a box!": pose}))
    convert_motion(recording, tmp_path / "turn.usda")
    stage = Usd.Stage.Open(str(tmp_path / "turn.usda"))
    xform = UsdGeom.Xform.Get(stage, "/World/a_box_")
    for k, turn in enumerate(turns):
        seen = np.array(xform.GetLocalTransformation(Usd.TimeCode(k))).T[:3, :3]
        np.testing.assert_allclose(seen, Rotation.from_rotvec(turn).as_matrix(), atol=1e-6)


def test_normals_stand_at_corners_and_points_are_shared(motion3d, tmp_path):
    convert_motion(motion3d, tmp_path / "press.usdc", Sampling(every=5))
    stage = Usd.Stage.Open(str(tmp_path / "press.usdc"))
    mesh = UsdGeom.Mesh.Get(stage, "/World/body")
    normals = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    assert normals.GetInterpolation() == UsdGeom.Tokens.faceVarying
    flat = np.array(normals.ComputeFlattened(3))
    points, index = np.array(mesh.GetPointsAttr().Get(3)), np.array(mesh.GetFaceVertexIndicesAttr().Get())
    assert len(points) == len(motion3d.rest.surface_nodes)
    corners = points[index].reshape(-1, 3, 3)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    # Within the angle from which an edge is sharp.
    assert (facing * flat[::3]).sum(axis=1).min() > np.cos(np.radians(50.0))


def test_colours_have_time_samples(motion, tmp_path):
    convert_motion(motion, tmp_path / "press.usda", colour="pressure")
    stage = Usd.Stage.Open(str(tmp_path / "press.usda"))
    mesh = UsdGeom.Mesh.Get(stage, "/World/body")
    colours = mesh.GetDisplayColorPrimvar()
    assert colours.GetInterpolation() == UsdGeom.Tokens.vertex
    first, last = (np.array(colours.Get(frame)) for frame in (0, 15))
    assert np.ptp(first, axis=0).max() == 0.0  # nothing is touched yet
    assert np.ptp(last, axis=0).max() > 0.3


def test_a_layer_that_would_fill_the_memory_is_refused(motion, tmp_path, monkeypatch):
    monkeypatch.setattr("softprint.runtime.convert.usd._MOST_BYTES", 1000)
    with pytest.raises(SoftprintError, match="of memory as USD: convert fewer"):
        convert_motion(motion, tmp_path / "press.usda")
    assert list(tmp_path.iterdir()) == []
