"""Shapes of one's own: their unit, size and middle, and what is said of those that cannot meet the body."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from softprint.runtime.cli.progress import FOLLOWED
from softprint.runtime.cli.run_steps import why_failed
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.kinds.mesh import MeshSpec
from softprint.runtime.colliders.kinds.polygon import PolygonSpec
from softprint.runtime.errors import SoftprintError
from tests.toy_experiment import write_experiment


@pytest.fixture
def experiment(tmp_path):
    """The block, whose ball stands 0.1 m beside the origin of its file."""
    path = write_experiment(tmp_path, 3)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    ball.apply_translation([0.1, 0.0, 0.0])
    ball.export(tmp_path / "ball.stl")
    return path


@pytest.mark.parametrize(
    ("keys", "extent", "middle"),
    [
        ({}, 30.0, [10.0, 0.0, 0.0]),
        ({"scale": 0.01}, 0.3, [0.1, 0.0, 0.0]),
        ({"unit": "mm"}, 0.03, [0.01, 0.0, 0.0]),
        ({"unit": "in", "centre": True}, 30 * 0.0254, [0.0, 0.0, 0.0]),
        ({"size": 0.02, "centre": True}, 0.04, [0.0, 0.0, 0.0]),
        ({"size": 0.02}, 0.04, [0.04 / 3, 0.0, 0.0]),
    ],
)
def test_unit_size_and_middle_of_a_file(tmp_path, keys, extent, middle):
    box = trimesh.creation.box(extents=[20.0, 30.0, 10.0])
    box.apply_translation([10.0, 0.0, 0.0])
    box.export(tmp_path / "box.stl")
    spec = MeshSpec.model_validate(
        {"name": "box", "shape": "mesh", "file": "box.stl", "resolution": 12, **keys}
    )
    collider = build_collider(spec, tmp_path)
    # bounds are those of the surface, to the single precision of an STL file
    np.testing.assert_allclose((collider.upper - collider.lower).max(), extent, rtol=1e-5)
    np.testing.assert_allclose(0.5 * (collider.upper + collider.lower), middle, atol=1e-5 * extent)


def test_a_polygon_has_the_same_keys(tmp_path):
    vertices = [[0.0, 0.0], [40.0, 0.0], [0.0, 20.0]]
    spec = PolygonSpec(name="p", shape="polygon", vertices=vertices, size=0.01, centre=True, resolution=32)
    collider = build_collider(spec, tmp_path)
    np.testing.assert_allclose(collider.upper, [0.01, 0.005], rtol=1e-9)
    np.testing.assert_allclose(collider.lower, [-0.01, -0.005], rtol=1e-9)


def test_one_length_is_enough():
    with pytest.raises(ValueError, match="give either `scale` or `size`"):
        MeshSpec(name="b", shape="mesh", file="b.stl", scale=0.1, size=0.02)


def test_a_collider_beside_its_origin_is_named_as_the_reason(experiment, softprint_here, tmp_path, monkeypatch):
    monkeypatch.setenv(FOLLOWED, str(tmp_path / "told"))
    # The scene that records states puts the ball, not its origin, above the block.
    text = experiment.read_text().replace("[0.0, 0.0, 0.085]", "[-0.1, 0.0, 0.085]")
    experiment.write_text(text.replace("[0.01, 0.0, 0.072]", "[-0.09, 0.0, 0.072]"))
    done = softprint_here("generate", experiment, "--units", "10")
    assert done.returncode == 1
    (said,) = [line for line in done.stderr.splitlines() if "contacts have no converged sample" in line]
    assert " of 10 contacts" in said
    assert "0.1 m away" in said
    assert "`centre = true`" in said
    assert why_failed((tmp_path / "told").read_text()) == said  # to `softprint run`, too


def test_its_middle_is_moved_on_request(experiment, softprint_here):
    experiment.write_text(experiment.read_text().replace("resolution = 16", "resolution = 16\ncentre = true"))
    done = softprint_here("generate", experiment, "--units", "3")
    assert done.returncode == 0, done.stderr
    assert "100.0 % converged" in done.stdout


@pytest.mark.parametrize("verb", ["generate", "simulate"])
def test_another_unit_is_named_as_the_reason(experiment, softprint_here, verb):
    experiment.write_text(
        experiment.read_text().replace("resolution = 16", "resolution = 16\nscale = 1000.0")
    )
    softprint_here("body", experiment)
    done = softprint_here(verb, experiment)
    assert done.returncode == 1
    said = done.stderr.splitlines()[-1]
    assert "'ball' is 40 m large and the body 0.1 m" in said
    assert '`unit = "mm"`' in said


def test_a_collider_that_never_touches_is_named(experiment, softprint):
    experiment.write_text(experiment.read_text().replace("0.072]", "0.285]").replace("0.075]", "0.285]"))
    softprint("body", experiment)
    done = softprint("simulate", experiment)
    assert done.returncode == 0, done.stderr
    assert "collider 'ball' never touches the body" in done.stdout + done.stderr


def test_a_pierced_body_is_named(experiment, softprint):
    """With contact at nodes, between which it passes, the ball ends in the middle of the block."""
    experiment.write_text(experiment.read_text().replace("0.072]", "0.03]").replace("0.075]", "0.03]"))
    centred = ("--set", "colliders.ball.centre=true", "--set", "contact.refinement=0")
    softprint("body", experiment, *centred)
    done = softprint("simulate", experiment, *centred)
    assert done.returncode == 0, done.stderr
    assert "the body is pierced in" in done.stdout + done.stderr
    assert "collider 'ball' is" in done.stdout + done.stderr


def test_a_config_error_under_mpirun_is_said_once(experiment, softprint_here):
    done = softprint_here("generate", experiment, "--set", "sampling.places=-3", ranks=2)
    assert done.returncode != 0
    (said,) = [
        line for line in done.stderr.splitlines() if "toy.toml" in line
    ]  # mpirun adds that a rank has ended
    assert "[sampling.places]" in said
    assert "Traceback" not in done.stderr


def test_a_time_that_is_no_number_is_refused(jelly3d_body):
    import softprint

    simulator = softprint.Simulator(jelly3d_body, contact=softprint.PenaltyContact(1e9))
    with pytest.raises(SoftprintError, match="the time is nan"):
        simulator.rest_state(time=float("nan"))


def test_a_shape_is_known_by_its_distances_and_not_by_its_name(dim):
    from softprint.runtime.colliders import Box, Sphere
    from softprint.runtime.colliders.shape_samples import is_same_shape, shape_samples

    ball = Sphere(0.02, dim, "ball")
    assert is_same_shape(Sphere(0.02, dim, "other name"), shape_samples(ball).tolist())
    assert not is_same_shape(Sphere(0.021, dim, "ball"), shape_samples(ball).tolist())
    assert not is_same_shape(Box(np.full(dim, 0.02), name="ball"), shape_samples(ball).tolist())
    assert not is_same_shape(Sphere(0.02, 5 - dim, "ball"), shape_samples(ball).tolist())


def test_another_resolution_is_the_same_shape(tmp_path):
    from softprint.runtime.colliders.shape_samples import is_same_shape, shape_samples

    trimesh.creation.icosphere(subdivisions=4, radius=0.02).export(tmp_path / "ball.stl")
    table = {"name": "ball", "shape": "mesh", "file": "ball.stl"}
    coarse, fine = (
        build_collider(MeshSpec.model_validate(table | {"resolution": cells}), tmp_path) for cells in (32, 48)
    )
    assert is_same_shape(coarse, shape_samples(fine).tolist())
