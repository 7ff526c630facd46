"""Kinematic handles and springs of a scene in an experiment file: their motion, in the subspace and in full space."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import build_body
from softprint.runtime.colliders import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.mesh import box_mesh, write_mesh
from softprint.runtime.scenes.playing import bare_model, play

EXPERIMENT = """
[experiment]
name = "led"
[body]
mesh = "box.vtu"
[body.handles]
points = 4
frames = [{{ name = "base", box = [{low}, {high}] }}]
[body.material]
young = 1e5
poisson = 0.4
[[colliders]]
name = "ball"
shape = "{ball}"
radius = 0.02
[dynamics]
gravity = {gravity}
time_step = 0.01
tolerance = 1e-8
[[scenes]]
name = "scene"
role = "test"
duration = 0.03
{handles}
"""

LED = """
[[scenes.kinematic]]
handle = "base"
keyframes = [
    {{ time = 0.0, position = {zero} }},
    {{ time = 0.02, position = {shift}, rotation = {turn} }},
]
[[scenes.kinematic]]
handle = 2
keyframes = [{{ time = 0.0, position = {zero} }}, {{ time = 0.02, position = {shift} }}]
"""

PULLED = """
[[scenes.springs]]
handle = "base"
stiffness = 100.0
rotation_stiffness = 1.0
keyframes = [{{ time = 0.0, position = {shift}, rotation = {turn} }}]
"""

TRACKED = """
[scenes.tracking]
file = "tracked.csv"
stiffness = 100.0
rotation_stiffness = 1.0
"""

TURN = {2: [0.2], 3: [0.05, -0.1, 0.15]}


@pytest.fixture(params=["bare", "full"])
def scene_of(request, tmp_path, dim):
    """scene_of(handles, gravity): the body, and the scene simulated with the model of that name."""

    def make(handles: str, gravity: float):
        words = {
            "low": [-1.0] * dim,
            "high": [1.0] * (dim - 1) + [0.013],
            "ball": "circle" if dim == 2 else "sphere",
            "gravity": [0.0] * (dim - 1) + [gravity],
            "zero": [0.0] * dim,
            "shift": [0.01] * dim,
            "turn": TURN[dim] if dim == 3 else TURN[dim][0],
        }
        write_mesh(tmp_path / "box.vtu", box_mesh([-0.05] * (dim - 1) + [0.0], [0.05] * dim, [4] * dim))
        file = tmp_path / "led.toml"
        file.write_text(EXPERIMENT.format(**words, handles=handles.format(**words)))
        experiment = load_experiment(file)
        body, scene = build_body(experiment.body, experiment.base_dir), experiment.scenes[0]
        if request.param == "bare":
            return body, bare_model(experiment, body, scene)
        pytest.importorskip("dolfinx")
        from softprint.fem_truth.dynamics.full_space_model import full_space_model

        return body, full_space_model(experiment, body, scene, tmp_path)

    return make


def moved(body, pose: RigidPose) -> np.ndarray:
    """Rest positions of the nodes of the frame, rotated about their mean and translated."""
    region = body.mesh.points[body.handles.frames[0].nodes]
    return pose.rotate(region - region.mean(axis=0)) + region.mean(axis=0) + pose.translation


def test_kinematic_handles_are_at_their_keyframes(scene_of, dim):
    body, model = scene_of(LED, -9.81)
    frame = body.handles.frames[0].nodes
    at_rest = RigidPose.identity(dim)
    # Half-way in time between two keyframes, the cubic and the rotation are half-way between their values.
    half = RigidPose.from_rotation_vector(0.5 * np.array(TURN[dim]), np.full(dim, 0.005))
    there = RigidPose.from_rotation_vector(np.array(TURN[dim]), np.full(dim, 0.01))
    results = list(play(model, 3))
    for result, pose in zip(results, [at_rest, half, there, there], strict=True):
        assert result.converged, result.reason
        x = model.positions(result.state)
        # Prescribed, not solved for: exact up to the round-off of 0.1 m, in the subspace up to that of the basis
        # (1e-13).
        np.testing.assert_allclose(x[frame], moved(body, pose), atol=1e-11)
        # A point is prescribed in the reduced state, in full space too.
        point = model.rows(result.state)[2]
        np.testing.assert_allclose(point, body.rest_rows[2] + pose.translation, atol=1e-11)
    free = np.setdiff1d(np.arange(body.n_nodes), frame)
    first, last = (model.positions(results[number].state)[free] for number in (0, -1))
    assert np.abs(last - first).min(axis=0).max() > 1e-3  # the rest of the body was dragged along


def test_a_spring_rotates_a_frame(scene_of, dim):
    body, model = scene_of(PULLED, 0.0)
    result = model.start()
    assert result.converged, result.reason
    region = body.mesh.points[body.handles.frames[0].nodes]
    target = RigidPose.from_rotation_vector(np.array(TURN[dim]), np.full(dim, 0.01) - region.mean(axis=0))
    # The whole body follows without strain, so that no force pulls back: exact up to the solver's tolerance.
    x = model.positions(result.state)[body.handles.frames[0].nodes]
    np.testing.assert_allclose(x, moved(body, target), atol=1e-6)


def test_a_frame_follows_a_recorded_motion(scene_of, tmp_path, dim):
    """The recorded corner of the frame is at rest before the scene, and rotated and translated at its start."""
    corner, shift, seen_at_rest = np.full(dim, -0.05), np.full(dim, 0.01), 0.4 * np.array(TURN[dim])
    pose = RigidPose.from_rotation_vector(np.array(TURN[dim]), np.zeros(dim))
    turned = pose.compose(RigidPose.from_rotation_vector(seen_at_rest, np.zeros(dim))).rotation_vector
    heading = {2: "frame,time,x,y,angle", 3: "frame,time,x,y,z,rx,ry,rz"}[dim]
    rows = [("base", -1.0, *corner, *seen_at_rest), ("base", 0.0, *(corner + shift), *turned)]
    lines = [heading, *(",".join(map(str, row)) for row in rows)]
    (tmp_path / "tracked.csv").write_text("\n".join(lines))
    body, model = scene_of(TRACKED, 0.0)
    result = model.start()
    assert result.converged, result.reason
    # Without strain, as above: the whole body follows the corner's motion, up to the solver's tolerance.
    wanted = pose.rotate(body.mesh.points - corner) + corner + shift
    np.testing.assert_allclose(model.positions(result.state), wanted, atol=1e-6)


@pytest.mark.parametrize("dim", [2])
def test_a_recorded_motion_of_another_body_is_refused(scene_of, tmp_path):
    (tmp_path / "tracked.csv").write_text("frame,time,x,y,angle\nbone,0,0,0,0\n")
    words = r"scenes\[0\].tracking.file \(tracked.csv\).*not the name of a frame.*known: base"
    with pytest.raises(SoftprintError, match=words):
        scene_of(TRACKED, 0.0)
