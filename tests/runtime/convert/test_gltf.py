"""glTF files, read by an independent reader that plays them: what is seen is the motion."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from softprint.runtime.convert.formats import convert_motion
from softprint.runtime.convert.frames import in_space, pose_in_space, surface_motion
from softprint.runtime.convert.gltf_document import Document
from softprint.runtime.convert.sampling import Sampling
from softprint.runtime.errors import SoftprintError
from tests.runtime.convert.gltf_reader import Gltf

# Displacements below 1e-5 of the body's size of 0.15 m are left out.
LEFT_OUT = 1.6e-6
ALL = Sampling(every=1)


@pytest.fixture(params=["glb", "gltf"])
def file(request, motion, tmp_path):
    path = tmp_path / f"a press.{request.param}"
    convert_motion(motion, path, ALL)
    return Gltf(path)


def test_the_played_surface_is_that_of_every_frame(file, motion):
    surface = surface_motion(motion)
    for frame in surface.frames():
        played = file.played("body", frame.time)
        # Corners of sharp edges are there more than once: compared as sets of points, both ways.
        own = in_space(frame.points)
        gaps = np.linalg.norm(played[:, None] - own, axis=2)
        assert gaps.min(axis=1).max() < LEFT_OUT
        assert gaps.min(axis=0).max() < LEFT_OUT


def test_between_two_frames_it_is_half_way(file, motion):
    k = 9
    half = 0.5 * (motion.times[k] + motion.times[k + 1])
    before, after = (file.played("body", motion.times[frame]) for frame in (k, k + 1))
    np.testing.assert_allclose(
        file.played("body", half), 0.5 * (before + after), atol=1e-7
    )  # float32 of 0.1 m


def test_colliders_move_as_rigid_nodes(file, motion):
    surface = surface_motion(motion)
    for name, (vertices, _) in surface.solids.items():
        for frame in (0, 7, 15):
            pose = pose_in_space(motion.colliders[name].poses[frame])
            placed, seen = pose.apply(in_space(vertices)), file.moved(name, motion.times[frame])
            gaps = np.linalg.norm(seen[:, None] - placed[::50], axis=2)
            assert gaps.min(axis=0).max() < 1e-7  # float32 of 0.1 m
            assert seen.min(axis=0) == pytest.approx(placed.min(axis=0), abs=1e-7)


def test_up_is_y(file, motion):
    points = file.to_y_up(file.played("body", 0.0))
    up = motion.rest.dim - 1
    assert np.ptp(points[:, 1]) == pytest.approx(np.ptp(motion.positions(0)[:, up]), abs=2 * LEFT_OUT)
    assert points[:, 1].max() > 0.05


def test_normals_of_every_frame_are_those_of_the_dent(motion3d, tmp_path):
    convert_motion(motion3d, tmp_path / "press.glb", ALL)
    file = Gltf(tmp_path / "press.glb")
    triangles = file.accessor(file.primitive("body")["indices"]).reshape(-1, 3)
    for time in motion3d.times[[0, 15]]:
        points, normals = (file.played("body", time, name) for name in ("POSITION", "NORMAL"))
        facing = np.cross(*(points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2)))
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        # Corners of smooth parts are within the angle from which an edge is sharp.
        assert (facing * normals[triangles[:, 0]]).sum(axis=1).min() > np.cos(np.radians(50.0))
    still, pressed = (file.played("body", time, "NORMAL") for time in motion3d.times[[0, 15]])
    assert np.abs(pressed - still).max() > 0.05


def test_trimesh_reads_the_scene_at_rest(motion3d, tmp_path):
    convert_motion(motion3d, tmp_path / "press.glb")
    scene = trimesh.load_scene(tmp_path / "press.glb")
    assert {"body", "ball"} <= set(scene.geometry)
    body = scene.geometry["body"]
    body.merge_vertices(merge_norm=True)
    assert body.is_watertight
    assert body.volume == pytest.approx(0.1 * 0.1 * 0.06, rel=1e-5)  # facing outward, in metres
    assert scene.extents[1] > 0.1  # the ball above the block, along y


def test_colours_are_those_of_the_frames(motion, tmp_path):
    convert_motion(motion, tmp_path / "press.glb", ALL, colour="displacement")
    file = Gltf(tmp_path / "press.glb")
    start, end = (file.played("body", time, "COLOR_0") for time in motion.times[[0, -1]])
    assert start.min() >= -3e-3  # changes of less than 2e-3 are left out
    assert end.max() <= 1 + 3e-3
    moved = np.linalg.norm(file.played("body", motion.times[-1]) - file.played("body", 0.0), axis=1)
    changed = np.linalg.norm(end - start, axis=1)
    assert np.corrcoef(moved, changed)[0, 1] > 0.8


def test_long_motions_keep_to_what_players_hold(motion3d, tmp_path):
    from dataclasses import replace

    convert_motion(replace(motion3d, times=motion3d.times * 200.0), tmp_path / "long.glb")
    assert len(Gltf(tmp_path / "long.glb").primitive("body")["targets"]) == 250
    with pytest.raises(SoftprintError, match="more than the 250 that players"):
        convert_motion(motion3d, tmp_path / "fast.glb", Sampling(rate=1000.0))


def test_one_frame_is_a_file_without_an_animation(motion, tmp_path):
    from softprint.runtime.convert.sampling import Moment

    convert_motion(motion, tmp_path / "one.glb", Sampling(Moment(5, True), Moment(5, True)))
    file = Gltf(tmp_path / "one.glb")
    assert "animations" not in file.json
    assert file.json["meshes"][0]["weights"] == [1.0]


def test_what_is_nearly_zero_is_left_out_and_read_as_zero(tmp_path):
    values = np.zeros((100, 3))
    values[7], values[60], values[61] = [0, 1, 0], [0, 0, 2], [1e-9, 0, 0]
    with (tmp_path / "data.bin").open("w+b") as binary:
        document = Document(binary)
        document.floats(np.arange(3.0), bounds=True)
        sparse = document.deltas(values, 1e-6, bounds=True)
        nothing = document.deltas(1e-9 * values, 1e-6)
        dense = document.deltas(values + 1.0, 1e-6)
        triangle = document.add(
            "meshes",
            {"primitives": [{"attributes": {"POSITION": sparse}, "indices": document.indices(np.arange(3))}]},
        )
        document.write_glb(tmp_path / "some.glb", binary)
    file = Gltf(tmp_path / "some.glb")
    assert triangle == 0
    values[61] = 0.0
    np.testing.assert_array_equal(file.accessor(sparse), values)
    np.testing.assert_array_equal(file.accessor(nothing), 0.0)
    np.testing.assert_array_equal(file.accessor(dense), np.float32(values + 1.0))
    assert file.json["accessors"][sparse]["sparse"]["count"] == 2
    assert "sparse" not in file.json["accessors"][dense]
