"""Free rigid bodies in a scene of an experiment file: their start, refusals, and what a motion records of them."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import build_body
from softprint.runtime.cli.context import Context
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.mesh import box_mesh, write_mesh
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.playing import bare_model, play
from softprint.runtime.scenes.simulate import simulate_scene

EXPERIMENT = """
[experiment]
name = "free"
[body]
mesh = "box.vtu"
[body.handles]
points = 4
frames = [{ name = "base", box = [[-1, -1], [1, 0.013]] }]
[body.material]
young = 1e5
poisson = 0.4
[[colliders]]
name = "ball"
shape = "circle"
radius = 0.02
[[colliders]]
name = "floor"
shape = "plane"
normal = [0, 1]
[dynamics]
gravity = [0, -9.81]
time_step = 0.01
[[scenes]]
name = "scene"
role = "test"
duration = 0.05
kinematic = ["base"]
[[scenes.colliders]]
name = "floor"
keyframes = [{ time = 0.0, position = [0.0, -0.01] }]
[[scenes.colliders]]
name = "ball"
"""
START = "density = 500.0\nposition = [0.3, 0.2]\nrotation = 0.5\nvelocity = [1.0, 0.0]\nspin = 2.0\n"


@pytest.fixture
def experiment_of(tmp_path):
    """The experiment with these keys for its ball."""
    write_mesh(tmp_path / "box.vtu", box_mesh([-0.05, 0.0], [0.05, 0.05], [4, 4]))

    def make(ball: str):
        (tmp_path / "free.toml").write_text(EXPERIMENT + ball)
        return load_experiment(tmp_path / "free.toml")

    return make


def test_it_starts_with_its_initial_state_and_falls(experiment_of):
    experiment = experiment_of(START)
    model = bare_model(experiment, build_body(experiment.body, experiment.base_dir), experiment.scenes[0])
    results = list(play(model, 5))
    pose, motion = results[0].state.poses["ball"], results[0].state.motions["ball"]
    np.testing.assert_allclose(pose.translation, [0.3, 0.2])
    np.testing.assert_allclose(pose.rotation_vector, [0.5])
    np.testing.assert_allclose(motion.velocity, [1.0, 0.0])
    end = results[-1].state.poses["ball"]
    # Free fall of backward Euler: sum_{k<=5} k h^2 g; the default tolerance is 1e-4 of the weights.
    np.testing.assert_allclose(end.translation, [0.35, 0.2 - 9.81 * 1e-4 * 15], atol=1e-6)
    np.testing.assert_allclose(end.rotation_vector, [0.6], atol=1e-6)


@pytest.mark.parametrize("model", ["bare", "full"])
def test_motions_record_its_poses(experiment_of, tmp_path, model):
    if model == "full":
        pytest.importorskip("dolfinx")
    experiment = experiment_of(START)
    body = build_body(experiment.body, experiment.base_dir)
    context = Context(experiment_path=experiment.path, out=tmp_path, quiet=True, rank=0)
    played = simulate_scene(context, body, experiment.scenes[0], model)
    track = load_motion(played.path).colliders["ball"]
    assert [pose.translation[0] for pose in track.poses] == pytest.approx([0.3, 0.31, 0.32, 0.33, 0.34, 0.35])
    assert simulate_scene(context, body, experiment.scenes[0], model).kept


@pytest.mark.parametrize(
    ("ball", "words"),
    [
        ("", ["colliders[1].keyframes]", "is missing", "density or a mass"]),
        ("density = 1.0\nmass = 2.0\nposition = [0, 1]", ["colliders[1].mass]", "in addition to a density"]),
        ("mass = 2.0", ["colliders[1].position]", "is missing"]),
        ("mass = 2.0\nposition = [0, 1, 2]", ["colliders[1].position]", "has 3 entries"]),
        ("mass = 2.0\nposition = [0, 1]\nspin = [1, 0, 0]", ["colliders[1].spin]", "one angle"]),
        (
            "mass = 2.0\nposition = [0, 1]\nvelocity = [0, -1e6]",
            ["colliders[1].velocity]", "10000 m in one step", "at most 1 m"],
        ),
        ("mass = -2.0\nposition = [0, 1]", ["colliders[1].mass]", "greater than 0"]),
        (
            "mass = 1.0\nposition = [0, 1]\nkeyframes = [{ time = 0.0, position = [0, 1] }]",
            ["colliders[1].keyframes]", "moves freely"],
        ),
        (
            "velocity = [0, 1]\nkeyframes = [{ time = 0.0, position = [0, 1] }]",
            ["colliders[1].velocity]", "is for colliders that move freely"],
        ),
        (
            'mass = 1.0\nposition = [0, 1]\n[[scenes.colliders]]\nname = "floor"\nmass = 1.0\nposition = [0, 0]',
            ["colliders[2].name]", "is a plane, which has no mass"],
        ),
    ],
)
def test_inconsistent_tables_are_refused(experiment_of, ball, words):
    with pytest.raises(SoftprintError) as refusal:
        experiment_of(ball)
    for word in words:
        assert word in str(refusal.value)
