"""Object-centric corrections by the command line alone: training, simulation, report, bench, inspect; with one collider
and two, with spheres of several sizes, and on top of an internal correction."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from softprint.runtime.body.body_file import load_body
from softprint.runtime.cli.main import main
from softprint.runtime.colliders import Sphere
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.correction_file import read_correction, read_header
from softprint.runtime.scenes.motion_file import load_motion
from tests.toy_experiment import write_experiment

MODELS = """
[training.thesis4]
steps = 150
batch = 64
validations = 3
[[training.models]]
name = "thesis4"
form = "thesis4"
hidden = [16, 16]
components = 4
[[training.models]]
name = "whole"
form = "thesis4"
hidden = [16, 16]
components = 4
target = "whole"
"""
TWO = """
[[colliders]]
name = "other"
shape = "circle"
radius = 0.02
[[scenes]]
name = "two"
role = "test"
duration = 0.1
kinematic = ["base"]
colliders = [
    { name = "disc", keyframes = [
        { time = 0.0, position = [-0.03, 0.081] }, { time = 0.1, position = [-0.03, 0.075] } ] },
    { name = "other", keyframes = [
        { time = 0.0, position = [0.03, 0.081] }, { time = 0.1, position = [0.03, 0.075] } ] },
]
"""


def written(folder: Path, dim: int, models: str = MODELS) -> Path:
    """The toy experiment with these models alone."""
    experiment = write_experiment(folder, dim)
    text = experiment.read_text()
    if dim == 3:  # the block sags, and the ball has to go deeper to touch it
        text = text.replace("0.0, 0.075]", "0.0, 0.062]")
    before, rest = text.split("[[training.models]]", 1)
    experiment.write_text(before + models + rest[rest.index("[body.handles]") :])
    return experiment


def test_from_truth_to_report(tmp_path, dim, capsys):
    experiment, run = written(tmp_path, dim), tmp_path / "run"
    if dim == 2:
        text = experiment.read_text().replace("[sampling]", '[sampling]\ncollider = "disc"')
        experiment.write_text(text.replace("[training]", '[training]\ncollider = "disc"') + TWO)
    here = [str(experiment), "--out", str(run), "--quiet"]
    everyone = [word for name in ("full", "bare", "thesis4", "whole") for word in ("--model", name)]
    for verb, *options in (("generate",), ("train",)):
        assert main([verb, *here, *options]) == 0
    assert main(["simulate", *here, "--scene", "held_out", *everyone]) == 0
    assert main(["report", *here, "--no-pictures"]) == 0
    report = json.loads((run / "report.json").read_text())
    # Learned from a dozen samples: it is judged and finite, and not far from the bare subspace.
    for name in ("thesis4", "whole"):
        assert 0.0 < report["errors"][name]["relative_rms"] < 2.0
    curves = json.loads((run / "corrections" / "thesis4.json").read_text())
    assert 0.0 < curves["discarded"] < 0.5
    capsys.readouterr()
    assert main(["inspect", str(run / "corrections" / "thesis4.safetensors")]) == 0
    assert "object-centric" in capsys.readouterr().out
    assert main(["bench", *here, "--model", "thesis4", "--steps", "1", "--scene", "held_out"]) == 0
    if dim == 2:  # one model for two colliders of the same shape
        assert main(["simulate", *here, "--scene", "two", "--model", "thesis4", "--model", "bare"]) == 0
        body = load_body(run / "body.h5")
        alone, with_both = (load_motion(run / "motions" / f"two_{name}.h5") for name in ("bare", "thesis4"))
        last = with_both.n_frames - 1
        added = with_both.positions(last) - body.reduced_positions(with_both.rows[last])
        assert not np.allclose(alone.positions(last), with_both.positions(last), atol=1e-6)
        # Both dents, one on each side.
        top = body.mesh.points[:, 1] > 0.05
        left, right = top & (body.mesh.points[:, 0] < -0.01), top & (body.mesh.points[:, 0] > 0.01)
        assert min(np.abs(added[left]).max(), np.abs(added[right]).max()) > 1e-4
    before = (run / "corrections" / "thesis4.safetensors").read_bytes()
    assert main(["train", *here]) == 0
    assert (run / "corrections" / "thesis4.safetensors").read_bytes() == before


@pytest.mark.parametrize("dim", [2])
def test_on_an_internal_correction(tmp_path, dim, capsys):
    """x = U q + F (r_int + r_ext): both are in the motion and in the report."""
    models = """
[training.thesis4]
steps = 50
validations = 1
[[training.models]]
name = "apart"
form = "thesis4"
hidden = [8, 8]
components = 4
added_to = "own"
[[training.internal]]
name = "own"
on = "subspace"
hidden = [8, 8]
components = 3
steps = 50
"""
    experiment, run = written(tmp_path, dim, models), tmp_path / "run"
    text = experiment.read_text().replace("[0, -9.81]", "[0, 0]").replace("states = 3", "states = 12")
    experiment.write_text(text)
    here = [str(experiment), "--out", str(run), "--quiet"]
    assert main(["generate", *here]) == 0
    assert main(["train", *here]) == 0
    names = ("full", "bare", "own", "apart")
    assert main(["simulate", *here, *[word for name in names for word in ("--model", name)]]) == 0
    assert main(["report", *here, "--no-pictures"]) == 0
    report = json.loads((run / "report.json").read_text())
    assert report["errors"]["apart"]["relative_rms"] != report["errors"]["own"]["relative_rms"]
    assert read_header(run / "corrections" / "apart.safetensors").added_to == "own"
    (run / "internal" / "own.safetensors").rename(run / "internal" / "other.safetensors")
    for verb in (("report", "--no-pictures"), ("simulate", "--model", "apart", "--no-resume")):
        capsys.readouterr()
        assert main([verb[0], *here, *verb[1:]]) == 1
        said = capsys.readouterr().err
        assert "own" in said, said
        assert "Traceback" not in said


def with_balls(folder: Path) -> Path:
    """The block in 3D, trained on balls of 16 and 24 mm, with one of 20 mm to choose by, and played with 20 mm."""
    models = MODELS[: MODELS.index('[[training.models]]\nname = "whole"')]
    experiment = written(folder, 3, models.replace("hidden", 'parameters = ["size"]\nhidden'))
    for radius in (16, 20, 24):
        trimesh.creation.icosphere(subdivisions=3, radius=1e-3 * radius).export(folder / f"ball_{radius}.stl")
    text = experiment.read_text().replace('shape = "mesh"\nfile = "ball.stl"\nresolution = 16', BALL)
    text = text.replace("[training]", 'SAMPLED[training]\ncollider = "library"').replace("SAMPLED", LIBRARY)
    experiment.write_text(text.replace("[sampling]", '[sampling]\ncollider = "library"'))
    return experiment


BALL = 'shape = "sphere"\nradius = 0.02'
LIBRARY = """
[library]
unit = "m"
size = 0.02
resolution = 24
meshes = ["ball_16.stl", "ball_24.stl"]
validation = ["ball_20.stl"]
"""


def test_the_size_of_a_collider_is_an_input(tmp_path, capsys):
    experiment, run = with_balls(tmp_path), tmp_path / "run"
    here = [str(experiment), "--out", str(run), "--quiet"]
    for verb, *options in (("generate",), ("train",), ("simulate", "--model", "thesis4")):
        assert main([verb, *here, *options]) == 0
    trained = read_correction(run / "corrections" / "thesis4.safetensors", load_body(run / "body.h5"))
    assert trained.is_for_any
    trained.on(Sphere(0.018, 3, name="unknown"))
    with pytest.raises(SoftprintError, match=r"size 0.016 to 0.024 m, and 'unknown' has 0.03 m"):
        trained.on(Sphere(0.03, 3, name="unknown"))
    # Not told, or with nothing to tell.
    text = experiment.read_text()
    capsys.readouterr()
    for before, after, message in (
        ('parameters = ["size"]', "", 'give its [[training.models]] table parameters = ["size"]'),
        ('"ball_16.stl", ', "", "nothing to learn from it"),
    ):
        experiment.write_text(text.replace(before, after))
        assert main(["train", *here, "--no-resume"]) == 1
        said = capsys.readouterr().err
        assert message in said, said
        assert "Traceback" not in said


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('target = "whole"', 'added_to = "none"', "added_to"),
        ('target = "whole"', 'parameters = ["weight"]', "parameters"),
        ('target = "whole"', 'activation = "elu"', "tanh layers"),
        ("components = 4", "components = 4000", "principal components are asked for"),
        ('target = "whole"', 'parameters = ["size"]', "nothing to learn from it"),
    ],
)
def test_bad_tables_are_refused_in_a_sentence(tmp_path, before, after, message, capsys):
    experiment, run = written(tmp_path, 2), tmp_path / "run"
    here = [str(experiment), "--out", str(run), "--quiet"]
    assert main(["generate", *here]) == 0
    experiment.write_text(experiment.read_text().replace(before, after))
    assert main(["train", *here]) == 1
    said = capsys.readouterr().err
    assert message in said, said
    assert "Traceback" not in said
