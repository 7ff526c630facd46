"""A new shape replaces a scene's collider (`simulate --collider`)."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from softprint.runtime.colliders.build import build_collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.scenes.replaced_collider import with_replaced_collider
from softprint.runtime.scenes.scene import find_scene
from tests.toy_experiment import write_experiment


def scene_of(folder, dim: int, *overrides: str):
    experiment = load_experiment(write_experiment(folder, dim), overrides)
    return experiment, find_scene(experiment, "held_out")


def test_a_mesh_is_scaled_to_the_collider_that_it_replaces(tmp_path):
    experiment, scene = scene_of(tmp_path, 3)
    trimesh.creation.box((2.0, 10.0, 4.0)).export(tmp_path / "brick.stl")
    other, changed = with_replaced_collider(experiment, scene, str(tmp_path / "brick.stl"))
    assert (changed.name, changed.colliders[0].name) == ("held_out_with_brick", "brick")
    assert changed.colliders[0].keyframes == scene.colliders[0].keyframes
    # The ball's radius is 0.02 m; its facets lie a little inside the sphere.
    brick = build_collider(other.collider("brick"))
    assert brick.size == pytest.approx(0.02, rel=1e-6)
    np.testing.assert_allclose(brick.upper - brick.lower, [0.008, 0.04, 0.016], rtol=1e-6)
    other, _ = with_replaced_collider(experiment, scene, f"ball={tmp_path / 'brick.stl'}", scale=0.002)
    assert build_collider(other.collider("brick")).size == pytest.approx(0.01)
    # The original experiment is not changed.
    with pytest.raises(KeyError):
        experiment.collider("brick")


def test_a_shape_of_the_library_and_a_polygon(tmp_path):
    experiment, scene = scene_of(tmp_path, 3, "library={size=0.05, resolution=12}", "training.models=[]")
    other, changed = with_replaced_collider(experiment, scene, "octahedron")
    assert changed.name == "held_out_with_octahedron_stand_in"
    assert other.collider("octahedron_stand_in").size == pytest.approx(0.02)
    assert other.collider("octahedron").size == 0.05
    flat, flat_scene = scene_of(tmp_path, 2)
    np.savetxt(tmp_path / "roof.txt", [[-2, 0], [2, 0], [0, 1]])
    other, _ = with_replaced_collider(flat, flat_scene, str(tmp_path / "roof.txt"))
    assert build_collider(other.collider("roof")).size == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("cube=brick.stl", ["no collider 'cube'", "it has ball"]),
        ("absent.stl", ["absent.stl", "no such"]),
        ("octagon", ["an STL, OBJ or PLY file, or the name of a shape"]),
    ],
)
def test_invalid_replacements_are_refused(tmp_path, asked, words):
    experiment, scene = scene_of(tmp_path, 3)
    with pytest.raises(SoftprintError) as caught:
        with_replaced_collider(experiment, scene, asked)
    assert all(word in str(caught.value) for word in words), caught.value


def test_a_shape_for_scenes_alone_and_two_colliders_one_after_the_other(tmp_path):
    experiment, scene = scene_of(
        tmp_path,
        3,
        "colliders=[{name='ball', shape='sphere', radius=0.02}, {name='die', shape='box', half_extents=[0.01, 0.01, "
        "0.01]}]",
        "sampling.collider='ball'",
        "training.collider='ball'",
        "scenes.held_out.colliders=[{name='ball', keyframes=[{time=0.0, position=[0, 0, 0.2]}]}, "
        "{name='die', keyframes=[{time=0.0, position=[0, 0, 0.3]}]}]",
    )
    other, changed = with_replaced_collider(*with_replaced_collider(experiment, scene, "ball=hat"), "die=mug")
    assert [entry.name for entry in changed.colliders] == ["hat", "mug"]
    assert changed.name == "held_out_with_hat_with_mug"
    assert [other.collider(name).size for name in ("hat", "mug")] == pytest.approx([0.02, 0.01])
    # The experiment text stored with the motion records the change, and is still a valid experiment.
    assert other.text == f"{experiment.text}\n# --collider ball=hat\n# --collider die=mug"


def test_a_half_space_cannot_be_replaced_without_a_size(tmp_path):
    experiment, scene = scene_of(
        tmp_path,
        3,
        "colliders=[{name='ball', shape='sphere', radius=0.02}, {name='floor', shape='plane', normal=[0, 0, 1]}]",
        "sampling.collider='ball'",
        "training.collider='ball'",
        "scenes.held_out.colliders.ball.name='floor'",
    )
    with pytest.raises(SoftprintError, match="--collider-scale"):
        with_replaced_collider(experiment, scene, "octahedron")
