"""A recording becomes a motion file and a scene that plays the same press again."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from softprint.runtime.colliders import KeyframedPath, RigidPose
from softprint.runtime.experiment import load_experiment
from softprint.runtime.inspect.kind import Part, inspect_file
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.playing import simulate
from softprint.runtime.viewer.processes.writing_process import WritingProcess
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.keyframes import ANGLE, keyframes, path_of
from softprint.runtime.viewer.session.recording import free_name
from softprint.runtime.viewer.session.session import Session


def recorded(session: Session, *targets, steps: int = 12):
    """A press through these targets, ended and returned."""
    name = session.tables[0].name
    session.handle(ask.Record(True))
    for target in targets:
        session.handle(ask.LeadCollider(name, target))
        for _ in range(steps):
            session.advance()
    session.handle(ask.Record(False))
    return session.finished_recordings.pop()


def test_a_recording_has_a_film_if_one_is_wanted(toy, tmp_path):
    session = Session(toy.workshop())
    recording = recorded(session, *targets(session.workshop.body.dim))
    recording.film = True
    notice = WritingProcess(recording, session.workshop, tmp_path, "hand_001").outcome(wait=True)
    assert notice.kind == "good", notice.text
    film = tmp_path / "hand_001_bare.gif"
    assert str(film) in notice.text
    with Image.open(film) as pictures:
        assert pictures.n_frames > 5  # 24 steps of 1/60 s or more, at 30 pictures a second


def targets(dim: int):
    """Down onto the block of the toy, and along its top."""
    if dim == 2:
        return np.array([0.0, 0.076]), np.array([0.01, 0.077])
    return np.array([0.01, 0.01, 0.076]), np.array([-0.005, 0.01, 0.077])


def test_the_scene_plays_the_same_press_again(toy, tmp_path):
    workshop = toy.workshop()
    session = Session(workshop)
    recording = recorded(session, *targets(session.body.dim))
    motion_file, scene_file = recording.write(workshop, tmp_path, "hand_001")
    session.close()
    motion = load_motion(motion_file)
    assert motion.n_frames == 24
    assert motion.converged.all()
    assert inspect_file(motion_file, Part(None, None)).kind == "a motion"
    pasted = toy.experiment.with_name("pasted.toml")
    pasted.write_text(toy.experiment.read_text() + scene_file.read_text())
    experiment = load_experiment(pasted)
    again = list(simulate(experiment, session.body, "hand_001", toy.out))
    before = np.array([np.linalg.norm(force) for force in motion.colliders[toy.collider].force])
    after = np.array([np.linalg.norm(result.contacts[toy.collider].force) for result in again])
    assert before.max() > 0.1  # N
    count = min(len(before), len(after))
    assert abs(len(before) - len(after)) <= 1
    # 3 %: the keyframes follow the path to 0.02 mm, and the scene begins settled.
    assert np.abs(before[:count] - after[:count]).max() < 0.03 * before.max()


def test_both_models_and_a_shape_that_the_experiment_lacks(toy3d, tmp_path):
    workshop = toy3d.workshop()
    session = Session(workshop, ("bare", "ours"))
    from softprint.runtime.colliders.kinds.box import BoxSpec

    session.handle(ask.SetShapes((BoxSpec(shape="box", name="brick", half_extents=[0.02, 0.01, 0.01]),)))
    session.fetch(wait=True)
    session.handle(ask.LeadHandle("base", np.array([0.002, 0.0, 0.0])))
    recording = recorded(session, np.array([0.01, 0.01, 0.068]))
    *motions, scene_file = recording.write(workshop, tmp_path, "hand_007")
    session.close()
    assert [path.name for path in motions] == ["hand_007_bare.h5", "hand_007_ours.h5"]
    pasted = toy3d.experiment.with_name("pasted_too.toml")
    pasted.write_text(toy3d.experiment.read_text() + scene_file.read_text())
    experiment = load_experiment(pasted)
    assert "brick" in experiment.collider_names
    scene = experiment.scenes[-1]
    assert [entry.handle for entry in scene.kinematic] == ["base"]
    assert len(list(simulate(experiment, session.body, "hand_007", toy3d.out))) > 5


def test_a_free_collider_is_recorded_with_its_motion(toy3d, tmp_path):
    workshop = toy3d.workshop()
    session = Session(workshop)
    session.handle(ask.DropCollider("ball", 500.0))
    session.fetch(wait=True)
    session.handle(ask.Record(True))
    for _ in range(10):
        session.advance()
    session.handle(ask.Record(False))
    _, scene_file = session.finished_recordings.pop().write(workshop, tmp_path, "hand_002")
    session.close()
    pasted = toy3d.experiment.with_name("pasted_free.toml")
    pasted.write_text(toy3d.experiment.read_text() + scene_file.read_text())
    entry = load_experiment(pasted).scenes[-1].colliders[0]
    assert entry.density == 500.0
    assert entry.velocity[-1] < 0.0


def test_what_changes_in_the_scene_ends_a_recording_and_keeps_it(toy3d):
    session = Session(toy3d.workshop())
    session.handle(ask.Record(True))
    for _ in range(3):
        session.advance()
    session.handle(ask.SetModels(("ours",)))
    session.fetch(wait=True)
    assert session.recording is None
    assert len(session.finished_recordings) == 1
    # One without a step is no recording.
    session.handle(ask.Record(True))
    session.handle(ask.Record(False))
    assert len(session.finished_recordings) == 1
    session.close()


def test_names_are_not_used_twice(tmp_path):
    assert free_name(tmp_path) == "hand_001"
    (tmp_path / "hand_001_bare.h5").touch()
    assert free_name(tmp_path) == "hand_002"
    assert free_name(tmp_path, {"hand_002"}) == "hand_003"


@pytest.mark.parametrize("turns", [False, True])
def test_keyframes_follow_the_path_within_their_tolerance(dim, turns):
    rng = np.random.default_rng(2)
    times = np.linspace(0.0, 2.0, 121)
    knots = np.linspace(0.0, 2.0, 7)
    angles = rng.uniform(-2.0, 2.0, (7, 1 if dim == 2 else 3)) if turns else None
    path = KeyframedPath(knots, rng.uniform(-0.05, 0.05, (7, dim)), angles)
    poses = [path.pose(float(time)) for time in times]
    kept = keyframes(times, poses, 2e-5)
    assert kept[0] == 0
    assert kept[-1] == 120
    assert len(kept) < 121
    found = path_of(times, poses, kept)
    for time, pose in zip(times, poses, strict=True):
        again = found.pose(float(time))
        assert np.linalg.norm(again.translation - pose.translation) <= 2e-5
        assert np.linalg.norm(again.compose(pose.inverse()).rotation_vector) <= ANGLE


def test_a_path_that_stands_still_has_two_keyframes(dim):
    poses = [RigidPose.identity(dim)] * 50
    assert keyframes(np.arange(50.0), poses, 1e-5).tolist() == [0, 49]
