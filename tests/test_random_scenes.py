"""The judge of random scenes (`benchmarks/random_scenes.py`)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import random_scenes
from benchmarks.random_scenes import Scenes, deepest_inside
from softprint.runtime.body import save_body
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_mechanics import compute_mechanics

MADE_WITH = {"seed": 0, "model": "mechanics"}
EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
EXPERIMENT = {2: "jelly2d_star_small", 3: "jelly3d_small"}


@pytest.mark.parametrize("with_mechanics", [False, True], ids=["bare", "mechanics"])
def test_the_depth_in_all_cells_is_that_of_the_contact_law(dim, jelly_body, with_mechanics):
    """A ball that rests in its dent is as deep inside the body as the contact law says, and far less deep than it was
    led in: the dent counts once. Facets are flat between their points, which is part of what they differ by."""
    body = jelly_body
    mechanics = compute_mechanics(body, 200, True) if with_mechanics else None
    ball = Sphere(0.02, dim, "ball")
    simulator = Simulator(
        body,
        [PlacedCollider("ball", ball)],
        contact=PenaltyContact(1e9, 1),
        mechanics=mechanics,
        kinematic=[KinematicHandle(frame.name) for frame in body.handles.frames[:1]],
    )
    led_in = 0.006
    at = np.append(np.zeros(dim - 1), body.mesh.points[:, -1].max() + 0.02 - led_in)
    state = simulator.rest_state(poses={"ball": RigidPose(np.eye(dim), at)})
    settled = simulator.settle(state)
    assert settled.converged
    depth, penetration = deepest_inside(simulator, settled.state), settled.contacts["ball"].penetration
    assert 0.1 * led_in < penetration < 0.7 * led_in
    assert depth == pytest.approx(penetration, rel=0.3)
    lifted = at + np.append(np.zeros(dim - 1), 0.01)
    away = simulator.settle(simulator.rest_state(poses={"ball": RigidPose(np.eye(dim), lifted)}))
    assert deepest_inside(simulator, away.state) == 0.0


def test_a_scene_is_drawn_from_its_number_alone(dim, jelly_body, tmp_path, monkeypatch):
    """Played twice, in any order, a scene is the same; others differ from it."""
    save_body(tmp_path / "body.h5", jelly_body)
    monkeypatch.setattr(random_scenes, "STEPS", 2)
    scenes = Scenes(EXAMPLES / f"{EXPERIMENT[dim]}.toml", tmp_path, seed=0)
    first, second, again = (scenes.play(number) for number in (0, 1, 0))
    assert first.error == ""
    assert first.steps == 2
    assert (first.kind, first.worst) == (again.kind, again.worst)
    assert first.slowest <= first.seconds
    assert first != second


def test_a_record_is_of_one_seed_and_model(tmp_path):
    path = tmp_path / "random_scenes.jsonl"
    assert random_scenes._read(path, MADE_WITH) == []
    scene = vars(random_scenes.Counted(scene=0, kind="bare"))
    with path.open("a") as file:
        file.write(json.dumps(scene) + "\n")
        file.write(json.dumps(scene)[:20])  # the process was killed
    assert random_scenes._read(path, MADE_WITH) == [scene]
    with path.open("a") as file:
        file.write(json.dumps(scene) + "\n")
    assert random_scenes._read(path, MADE_WITH) == [scene, scene]
    with pytest.raises(SoftprintError, match=r"'seed': 0.*'seed': 1.*remove it to start again"):
        random_scenes._read(path, MADE_WITH | {"seed": 1})
