"""PC2 point caches and OBJ sequences, read by other programs' rules."""

from __future__ import annotations

import struct

import meshio
import numpy as np
import pytest
import trimesh

from softprint.runtime.convert.formats import convert_motion
from softprint.runtime.convert.frames import in_space, surface_motion
from softprint.runtime.convert.sampling import Sampling
from softprint.runtime.errors import SoftprintError


def read_pc2(path):
    """The parser of the format's definition: first frame, frames a sample, and (samples, points, 3) positions."""
    data = path.read_bytes()
    assert data[:12] == b"POINTCACHE2\0"
    version, points, start, step, samples = struct.unpack("<iiffi", data[12:32])
    assert version == 1
    assert len(data) == 32 + samples * points * 12
    return start, step, np.frombuffer(data, "<f4", offset=32).reshape(samples, points, 3)


def obj_lines(path):
    """(v, 3) vertices and the 1-based corners of faces and lines, in the order of the file."""
    words = [line.split() for line in path.read_text().splitlines() if line[0] != "#"]
    vertices = np.array([[float(x) for x in line[1:]] for line in words if line[0] == "v"])
    return vertices, {
        kind: [[int(k) for k in line[1:]] for line in words if line[0] == kind] for kind in "fl"
    }


def test_a_point_cache_moves_the_vertices_of_its_obj(motion, tmp_path):
    files = convert_motion(motion, tmp_path / "press.pc2")
    assert [file.name for file in files] == ["press.pc2", "press.obj"]
    start, step, cache = read_pc2(tmp_path / "press.pc2")
    assert (start, step) == (0.0, 1.0)
    vertices, corners = obj_lines(tmp_path / "press.obj")
    surface = surface_motion(motion)
    assert cache.shape == (16, len(vertices), 3)
    np.testing.assert_allclose(vertices, in_space(surface.rest), atol=1e-9)
    np.testing.assert_array_equal(np.array(corners["f"]) - 1, surface.triangles)
    for number, frame in enumerate(surface.frames()):
        np.testing.assert_array_equal(cache[number], np.float32(in_space(frame.points)))


def test_a_mesh_of_another_program_is_not_overwritten(motion, tmp_path):
    (tmp_path / "press.obj").write_text("v 0 0 0\n")
    with pytest.raises(SoftprintError, match="a file of another program is where the surface at rest"):
        convert_motion(motion, tmp_path / "press.pc2")
    assert [path.name for path in tmp_path.iterdir()] == ["press.obj"]


def test_other_programs_read_the_surface_at_rest(motion3d, tmp_path):
    convert_motion(motion3d, tmp_path / "press.pc2")
    mesh = meshio.read(tmp_path / "press.obj")
    assert len(mesh.points) == len(motion3d.rest.surface_nodes)
    mesh = trimesh.load_mesh(tmp_path / "press.obj", process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(0.1 * 0.1 * 0.06, rel=1e-6)


def test_a_sequence_has_the_bodies_of_every_frame(motion, tmp_path):
    files = convert_motion(motion, tmp_path / "press.obj", Sampling(every=5))
    assert [file.name for file in files] == [f"press_000{k}.obj" for k in (1, 2, 3, 4)]
    surface = surface_motion(motion, Sampling(every=5))
    ((vertices, facets),) = surface.solids.values()
    for file, frame in zip(files, surface.frames(), strict=True):
        found, corners = obj_lines(file)
        (pose,) = frame.poses.values()
        own = np.concatenate([frame.points, pose.apply(vertices)])
        np.testing.assert_allclose(found, in_space(own), rtol=1e-8, atol=1e-12)  # nine digits
        lines = corners["f" if motion.rest.dim == 3 else "l"]
        assert np.array(lines)[-len(facets) :].min() == len(frame.points) + 1


def test_frames_of_a_longer_sequence_do_not_stay(motion, tmp_path):
    convert_motion(motion, tmp_path / "press.obj", Sampling(every=2))
    theirs = tmp_path / "press_0042.obj"
    theirs.write_text("v 0 0 0\n")
    (tmp_path / "press_0002_old.obj").write_text("# Softprint: another name")
    convert_motion(motion, tmp_path / "press.obj", Sampling(every=10))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "press_0001.obj",
        "press_0002.obj",
        "press_0002_old.obj",
        "press_0042.obj",  # of another program
    ]


def test_no_frame_takes_the_place_of_a_file_of_another_program(motion, tmp_path):
    (tmp_path / "press_0002.obj").write_text("v 0 0 0\n")
    with pytest.raises(SoftprintError, match=r"press_0002\.obj: a file of another program is where a frame"):
        convert_motion(motion, tmp_path / "press.obj", Sampling(every=2))
    assert [path.name for path in tmp_path.iterdir()] == ["press_0002.obj"]
