"""Scenes simulated to motion files: round trip, reuse, and refusals."""

import argparse
import json
from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.body import build_body, load_body
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.verbs.bench_verb import VERB as BENCH
from softprint.runtime.cli.verbs.fields_verb import VERB as FIELDS
from softprint.runtime.cli.verbs.simulate_verb import VERB as SIMULATE
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.kinds.polygon import PolygonSpec
from softprint.runtime.colliders.kinds.registry import DifferenceSpec, UnionSpec
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.sources import with_absolute_paths
from softprint.runtime.inspect.kind import Part
from softprint.runtime.inspect.picture import picture_of
from softprint.runtime.mesh import box_mesh, write_mesh
from softprint.runtime.scenes.motion_colliders import build_colliders
from softprint.runtime.scenes.motion_file import load_motion, side_file
from softprint.runtime.scenes.playing import bare_model, build_model, play
from softprint.runtime.scenes.replaced_collider import with_replaced_collider
from softprint.runtime.scenes.scene import find_scene, scene_parts, scene_steps
from softprint.runtime.scenes.simulate import motion_path, simulate_scene
from tests.bad_input.altered import altered_h5
from tests.toy_truth import BLOCK

# Friction is that of the default.
EXPERIMENT = (
    BLOCK.replace("friction = 0.0\n", "")
    + """
[[scenes]]
name = "press"
role = "test"
duration = 0.1
kinematic = ["base"]
springs = [{ handle = 1, stiffness = 5.0, keyframes = [{ time = 0, position = [0.1, 0.05] }] }]
[[scenes.colliders]]
name = "ball"
keyframes = [{ time = 0.0, position = [0.08, 0.08] }, { time = 0.1, position = [0.08, 0.06], rotation = 0.5 }]
[[scenes]]
name = "fall"
role = "record"
duration = 0.05
"""
)


@pytest.fixture
def context(tmp_path):
    write_mesh(tmp_path / "box.vtu", box_mesh([0.0, 0.0], [0.1, 0.05], [10, 5]))
    (tmp_path / "toy.toml").write_text(EXPERIMENT)
    return Context(
        experiment_path=tmp_path / "toy.toml",
        out=tmp_path / "run",
        quiet=True,
        rank=0,
        write=lambda text: None,
    )


def options(verb, *words):
    parser = argparse.ArgumentParser()
    verb.configure(parser)
    return parser.parse_args(words)


def test_a_simulated_scene_round_trips(context):
    assert SIMULATE.run(options(SIMULATE), context) == 0
    body = load_body(context.out_dir / "body.h5")
    scene = find_scene(context.experiment, "press")
    motion = load_motion(motion_path(context.out_dir, "press", "bare"))
    model = bare_model(context.experiment, body, scene)
    frames = list(play(model, scene_steps(context.experiment, scene)))
    assert motion.n_frames == len(frames) == 7  # 0.1 s of 1/60 s, and frame 0
    assert motion.body_hash == body.content_hash
    assert (motion.model, motion.scene) == ("bare", "press")
    for frame, result in enumerate(frames):
        np.testing.assert_allclose(motion.rows[frame], result.state.rows, atol=1e-12)
        # Positions are float32: 6e-8 of 0.1 m.
        np.testing.assert_allclose(motion.positions(frame), model.positions(result.state), atol=1e-8)
        assert motion.times[frame] == pytest.approx(result.state.time)
        assert motion.status_names[int(motion.status[frame])] == result.status.name
        ball = motion.colliders["ball"]
        np.testing.assert_allclose(ball.poses[frame].matrix, result.state.poses["ball"].matrix)
        np.testing.assert_allclose(ball.force[frame], result.contacts["ball"].force, atol=1e-9)
        assert motion.penetration[frame] == pytest.approx(result.penetration)
    assert motion.converged.all()
    assert motion.penetration[-1] > 0
    np.testing.assert_array_equal(motion.in_contact, motion.penetration > 0)
    np.testing.assert_array_equal(motion.in_contact, [result.in_contact for result in frames])
    assert {"total", "elastic", "contact"} <= set(motion.timings)
    assert "elastic" in motion.energies


def test_pierced_and_inverted_frames_are_invalid(context):
    SIMULATE.run(options(SIMULATE), context)
    motion = load_motion(motion_path(context.out_dir, "press", "bare"))
    deepest = motion.colliders["ball"].intrusion
    assert not motion.invalid(1.01 * deepest.max()).any()
    np.testing.assert_array_equal(motion.invalid(0.99 * deepest.max()), deepest > 0.99 * deepest.max())
    inverted = np.r_[-0.1, motion.min_det_F[1:]]
    np.testing.assert_array_equal(
        replace(motion, min_det_F=inverted).invalid(1.0), np.arange(motion.n_frames) == 0
    )


def test_the_side_file_names_every_frame(context):
    SIMULATE.run(options(SIMULATE), context)
    text = side_file(motion_path(context.out_dir, "press", "bare")).read_text()
    assert text.count("<Time ") == 7
    assert "press_bare.h5:/positions" in text


def test_a_finished_motion_is_kept_while_its_inputs_are_the_same(context):
    body = build_body(context.experiment.body, context.experiment.base_dir)
    scene = find_scene(context.experiment, "press")
    first = simulate_scene(context, body, scene, "bare")
    side_file(first.path).unlink()
    again = simulate_scene(context, body, scene, "bare")
    assert (first.kept, again.kept) == (False, True)
    assert side_file(first.path).is_file()
    softer = Context(context.experiment_path, ("contact.stiffness=5e8",), context.out, quiet=True, rank=0)
    assert not simulate_scene(softer, body, scene, "bare").kept
    first.path.write_bytes(b"cut short")
    assert not simulate_scene(softer, body, scene, "bare").kept  # a damaged file is made again
    softer.resume = False
    assert not simulate_scene(softer, body, scene, "bare").kept


def test_a_collider_is_built_once_for_a_motion(context, monkeypatch):
    body = body_of_run(context)
    kind = type(context.experiment.collider("ball"))
    make, made = kind.make, []
    monkeypatch.setattr(kind, "make", lambda *own: made.append(own[1]) or make(*own))
    simulate_scene(context, body, find_scene(context.experiment, "press"), "bare")
    assert made == ["ball"]


def test_an_interrupted_scene_leaves_no_file(context, monkeypatch):
    body = build_body(context.experiment.body, context.experiment.base_dir)
    scene = find_scene(context.experiment, "press")

    def interrupted(model, n_steps):
        yield model.start()
        raise KeyboardInterrupt

    monkeypatch.setattr("softprint.runtime.scenes.simulate.play", interrupted)
    with pytest.raises(KeyboardInterrupt):
        simulate_scene(context, body, scene, "bare")
    assert list((context.out_dir / "motions").iterdir()) == []


def test_a_scene_with_a_free_body_starts_at_rest(context):
    body = build_body(context.experiment.body, context.experiment.base_dir)
    scene = find_scene(context.experiment, "fall")
    first, *_, last = play(
        bare_model(context.experiment, body, scene), scene_steps(context.experiment, scene)
    )
    np.testing.assert_array_equal(first.state.rows, body.rest_rows)
    assert first.converged
    assert last.state.rows_velocity[0, 1] == pytest.approx(-9.81 * 0.05)  # v = g t, exact for backward Euler


def test_the_parts_of_a_scene_are_those_of_the_file(context):
    parts = scene_parts(context.experiment, find_scene(context.experiment, "press"))
    assert parts.held
    assert parts.friction.coefficient == pytest.approx(0.3)
    assert parts.springs[0].handle == 1
    assert parts.settings.time_step == pytest.approx(1 / 60)
    np.testing.assert_allclose(parts.colliders[0].path.pose(0.1).rotation_vector, [0.5])


def test_names_that_do_not_exist_are_refused(context):
    body = build_body(context.experiment.body, context.experiment.base_dir)
    scene = find_scene(context.experiment, "press")
    with pytest.raises(SoftprintError, match="no scene 'pres'; its scenes: press, fall"):
        find_scene(context.experiment, "pres")
    with pytest.raises(SoftprintError, match=r"no model 'theirs'.*Known models: bare"):
        build_model(context.experiment, body, scene, context.out_dir, "theirs")


@pytest.mark.parametrize(
    ("change", "part"),
    [("body.material.young=2e5", "material"), ('body.handles.hold="projection"', "hold")],
)
def test_another_body_in_the_run_directory_is_refused(context, change, part):
    SIMULATE.run(options(SIMULATE), context)
    other = Context(
        context.experiment_path,
        (change,),
        context.out,
        quiet=True,
        rank=0,
        write=lambda text: None,
    )
    with pytest.raises(SoftprintError, match=rf"its {part}[\s]differs"):
        SIMULATE.run(options(SIMULATE), other)


def test_bad_motion_files_are_named(context, tmp_path):
    SIMULATE.run(options(SIMULATE), context)
    path = motion_path(context.out_dir, "press", "bare")
    with pytest.raises(SoftprintError, match="no frame 7"):
        load_motion(path).positions(7)
    with pytest.raises(SoftprintError, match="there is no such motion file"):
        load_motion(tmp_path / "none.h5")
    with pytest.raises(SoftprintError, match="this is a body file"):
        load_motion(context.out_dir / "body.h5")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SoftprintError, match="truncated, damaged"):
        load_motion(path)
    path.write_bytes(whole)
    with altered_h5(path) as file:
        del file["rows"]
    with pytest.raises(SoftprintError, match="incomplete"):
        load_motion(path)


def test_bench_prints_a_table_and_keeps_it(context):
    said = []
    context.write = said.append
    assert BENCH.run(options(BENCH, "--model", "bare", "--iterations", "1", "--steps", "2"), context) == 0
    assert any(line.startswith("bare") for line in said)
    assert json.loads((context.out_dir / "bench.json").read_text())["cores_used"] == 1
    on_two = options(BENCH, "--model", "bare", "--steps", "2", "--cores", "2")
    assert BENCH.run(on_two, context) == 0
    kept = json.loads((context.out_dir / "bench.json").read_text())
    assert (kept["cores_used"], kept["speeds"][0]["steps"]) == (2, 2)
    assert kept["tolerance"] == context.experiment.dynamics.tolerance
    assert BENCH.run(options(BENCH, "--model", "bare"), context) == 0
    whole = json.loads((context.out_dir / "bench.json").read_text())["speeds"][0]
    assert whole["steps"] > 2  # all that are in contact, where nothing is said
    assert whole["median"] <= whole["p95"]
    with pytest.raises(SystemExit):
        options(BENCH, "--steps", "0")
    with pytest.raises(SoftprintError, match="has no contact"):
        BENCH.run(options(BENCH, "--model", "bare", "--scene", "fall"), context)


def test_a_motion_records_its_colliders(context, tmp_path):
    """Also a replacement from a file that is in no experiment: it is found from any folder while the file exists."""
    roof = tmp_path / "roof.txt"
    roof.write_text("0 -1\n1 1\n-1 1\n")
    body = body_of_run(context)
    experiment, scene = with_replaced_collider(
        context.experiment, find_scene(context.experiment, "press"), str(roof)
    )
    motion = load_motion(simulate_scene(context, body, scene, "bare", experiment).path)
    (roof_again,) = build_colliders(motion.collider_tables, motion.path).values()
    asked = experiment.collider("roof")
    probes = np.random.default_rng(0).uniform(-0.02, 0.02, (20, 2))
    np.testing.assert_array_equal(roof_again.sdf(probes), build_collider(asked).sdf(probes))
    fields = argparse.Namespace(motion="press_with_roof_bare", frame=[3], sample=None, contact=None)
    assert FIELDS.run(fields, context) == 0
    picture_of(motion.path, Part(None, 3), tmp_path / "roof.png", None)
    assert (tmp_path / "roof.png").stat().st_size > 1000
    roof.unlink()
    with pytest.raises(
        SoftprintError, match=r"press_with_roof_bare.h5: one of its colliders cannot be built"
    ):
        build_colliders(motion.collider_tables, motion.path)


def test_files_of_parts_are_named_by_their_whole_paths(tmp_path):
    part = PolygonSpec(shape="polygon", file="star.txt")
    union = UnionSpec(shape="union", parts=[part, part], blend=0.1)
    cut = DifferenceSpec(shape="difference", base=part, parts=[union], blend=0.1)
    whole = with_absolute_paths(cut, tmp_path)
    assert whole.base.file == whole.parts[0].parts[1].file == tmp_path / "star.txt"
