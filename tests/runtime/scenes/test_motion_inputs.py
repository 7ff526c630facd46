"""The inputs of a motion: a change of a file that its scene uses makes it a different motion."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from softprint.runtime.experiment import load_experiment
from softprint.runtime.scenes import simulate
from softprint.runtime.scenes.scene import find_scene
from softprint.runtime.scenes.simulate import inputs_hash
from tests.toy_experiment import write_experiment

MOTION = "frame,time,x,y,z,rx,ry,rz\nbase,0,0,0,{},0,0,0\n"
BODY = SimpleNamespace(
    content_hash="the body",
    cubature=SimpleNamespace(weights=np.ones(1), cells=np.zeros(1, dtype=np.int64)),
    surface=SimpleNamespace(nodes=np.zeros(1, dtype=np.int64)),
)


def test_motions_depend_on_the_files_of_their_scene(tmp_path):
    (tmp_path / "motion.csv").write_text("frame,time,x,y,z,rx,ry,rz\nbase,0,0,0,0,0,0,0\n")
    parts = "[{shape='mesh', file='ball.stl'}, {shape='sphere', radius=0.01}]"
    experiment = load_experiment(
        write_experiment(tmp_path, 3),
        [
            f"colliders=[{{name='ball', shape='union', blend=0.001, parts={parts}}}]",
            "scenes.held_out.tracking={file='motion.csv', stiffness=1.0, rotation_stiffness=1.0}",
        ],
    )
    scene = find_scene(experiment, "held_out")
    other = scene.model_copy(update={"tracking": None})

    def digest(of=scene) -> str:
        return inputs_hash(experiment, BODY, of, tmp_path, "bare")

    before, untracked = digest(), digest(other)
    assert digest() == before
    (tmp_path / "motion.csv").write_text("frame,time,x,y,z,rx,ry,rz\nbase,0,0,0,0.01,0,0,0\n")
    assert digest() != before
    assert digest(other) == untracked
    before = digest()
    (tmp_path / "ball.stl").write_bytes((tmp_path / "ball.stl").read_bytes() + b"\0")
    assert digest() != before
    assert digest(other) != untracked


def test_contact_has_a_version(tmp_path, monkeypatch):
    """Motions are made again when it has changed."""
    experiment = load_experiment(write_experiment(tmp_path, 3))
    scene = find_scene(experiment, "held_out")
    digests = []
    for version in (1, 2):
        monkeypatch.setattr(simulate, "CONTACT_VERSION", version)
        digests.append(inputs_hash(experiment, BODY, scene, tmp_path, "bare"))
    assert digests[0] != digests[1]


def test_frames_that_move_freely_in_full_space_have_a_version(tmp_path, monkeypatch):
    """Where every frame is kinematic, and in reduced models, frames have always been rigid."""
    experiment = load_experiment(write_experiment(tmp_path, 3))
    scene = find_scene(experiment, "held_out")
    frames = [SimpleNamespace(name=handle) for handle in scene.kinematic_handles]
    assert frames
    held = SimpleNamespace(**vars(BODY), handles=SimpleNamespace(frames=frames))
    free = SimpleNamespace(
        **vars(BODY), handles=SimpleNamespace(frames=[*frames, SimpleNamespace(name="bone")])
    )

    def digests() -> list[str]:
        pairs = [(held, "full"), (free, "bare"), (free, "full")]
        return [inputs_hash(experiment, body, scene, tmp_path, model) for body, model in pairs]

    before = digests()
    monkeypatch.setattr(simulate, "_FRAMES_VERSION", 99)
    after = digests()
    assert after[:2] == before[:2]
    assert after[2] != before[2]
