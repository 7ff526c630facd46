"""Internal corrections by the command line alone: states, training, simulation, report; 2D and 3D."""

from __future__ import annotations

import json

import pytest

from softprint.runtime.cli.main import main
from softprint.runtime.mesh import box_mesh, write_mesh

MODELS = ("condensed", "thesis4", "ours", "quadratic", "modes")
EXPERIMENT = """
[experiment]
name = "bar"
seed = 3
[body]
mesh = "bar.vtu"
[body.handles]
points = 2
frames = [{ name = "left", box = LEFT }, { name = "right", box = RIGHT }]
[body.material]
young = 2e4
poisson = 0.4
density = 1000.0
[dynamics]
time_step = 0.02
gravity = GRAVITY
max_iterations = 40
[sampling]
states = 24
record_with = "condensed"
disturbed = 1
disturbance = 0.002
[[training.internal]]
name = "thesis4"
on = "subspace"
hidden = [12, 12]
components = 4
linear = false
steps = 200
validations = 2
[[training.internal]]
name = "ours"
hidden = [12, 12]
components = 4
steps = 200
validations = 2
[[training.internal]]
name = "quadratic"
quadratic = true
components = 8
cubature = 80
[[training.internal]]
name = "modes"
equilibrium = true
components = 8
cubature = 80
"""
SCENE = """
[[scenes]]
name = "NAME"
role = "ROLE"
duration = 0.5
kinematic = [
    { handle = "left", keyframes = [{ time = 0.0, position = ZERO }] },
    { handle = "right", keyframes = [{ time = 0.0, position = ZERO }, { time = 0.4, position = PULLED }] },
]
"""


@pytest.fixture
def experiment(tmp_path, dim):
    """A bar between two frames, pulled."""
    size, counts = ([0.08, 0.02], [16, 4]) if dim == 2 else ([0.08, 0.02, 0.02], [10, 3, 3])
    write_mesh(tmp_path / "bar.vtu", box_mesh([0.0] * dim, size, counts))
    wide = [1.0] * (dim - 1)
    text = EXPERIMENT.replace("LEFT", str([[-1.0] * dim, [0.0101, *wide]]))
    text = text.replace("RIGHT", str([[0.0699, *(-1.0 for _ in wide)], [1.0] * dim]))
    text = text.replace("GRAVITY", str([0.0] * dim))
    for name, role, pull in (("pull", "record", 0.03), ("held_out", "test", 0.025)):
        scene = SCENE.replace("NAME", name).replace("ROLE", role).replace("ZERO", str([0.0] * dim))
        text += scene.replace("PULLED", str([pull, *([0.0] * (dim - 1))]))
    path = tmp_path / "bar.toml"
    path.write_text(text)
    return path


@pytest.mark.slow
def test_from_states_to_report(experiment, tmp_path, dim, capsys):
    run = tmp_path / "run"
    here = [str(experiment), "--out", str(run), "--quiet"]
    everyone = [word for model in ("full", "bare", *MODELS) for word in ("--model", model)]
    for verb, *options in (("generate",), ("train",), ("simulate", *everyone), ("report",)):
        assert main([verb, *here, *options]) == 0
    report = json.loads((run / "report.json").read_text())
    assert report["collider"] is None
    assert set(MODELS) <= set(report["errors"])
    assert report["errors"]["bare"]["relative_rms"] == pytest.approx(1.0)
    # Condensation is right to first order, and a correction is nearer to full space than what it is added to.
    assert report["errors"]["thesis4"]["relative_rms"] < 1.0
    assert report["errors"]["ours"]["relative_rms"] < report["errors"]["condensed"]["relative_rms"] < 0.5
    # A fit in closed form and modes in equilibrium come nearer than a network from as few states.
    for name in ("quadratic", "modes"):
        assert report["errors"][name]["relative_rms"] < report["errors"]["ours"]["relative_rms"]
    (scene,) = report["scenes"]
    assert scene["n_contact"] == scene["n_frames"] - 1 == 25
    assert set(MODELS) <= set(scene["free"]) & set(report["timings"])
    assert set(report["held_out_states"]) == {"thesis4", "ours", "quadratic", "modes"}
    assert "without a collider" in (run / "report.html").read_text()
    # What exists is kept, and some can be asked for alone.
    before = (run / "internal" / "ours.safetensors").read_bytes()
    assert main(["train", *here, "--model", "ours", "--model", "modes"]) == 0
    assert (run / "internal" / "ours.safetensors").read_bytes() == before
    capsys.readouterr()
    assert main(["train", *here, "--model", "ours", "--model", "theirs"]) == 1
    assert "there: thesis4, ours, quadratic, modes" in capsys.readouterr().err
    assert main(["inspect", str(run / "internal" / "thesis4.safetensors")]) == 0
    assert "the subspace alone" in capsys.readouterr().out
    assert main(["inspect", str(run / "internal" / "modes.safetensors")]) == 0
    assert "modes in elastic equilibrium" in capsys.readouterr().out
    assert main(["inspect", str(run / "internal" / "quadratic.safetensors")]) == 0
    assert "quadratic in the state" in capsys.readouterr().out
    assert main(["simulate", *here, "--model", "theirs"]) == 1
    assert "thesis4" in capsys.readouterr().err


@pytest.mark.parametrize("dim", [2])
@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('on = "subspace"', 'on = "nothing"', "training.internal"),
        ('name = "ours"', 'name = "thesis4"', "is used twice"),
        ('name = "ours"', 'name = "condensed"', "choose another name"),
        ("components = 4", "components = 0", "components"),
        ("hidden = [12, 12]", "hidden = []", "hidden"),
        ("equilibrium = true", "equilibrium = true\nhidden = [8]\nsteps = 9", "leave hidden, steps out"),
        ("equilibrium = true", 'equilibrium = true\non = "condensation"', "on the subspace"),
        ("disturbed = 1", "longest_move = 0.1", "longest_move is of states"),
        ("quadratic = true", "quadratic = true\nsteps = 9", "with quadratic = true there is no network"),
        ("quadratic = true", "quadratic = true\nequilibrium = true", "two corrections"),
    ],
)
def test_bad_tables_are_refused_in_a_sentence(experiment, dim, before, after, message, capsys):
    experiment.write_text(experiment.read_text().replace(before, after, 1))
    assert main(["train", str(experiment), "--quiet"]) == 1
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said


@pytest.mark.parametrize("dim", [2])
def test_too_many_components_are_refused(experiment, dim, tmp_path, capsys):
    """Before any file of the correction is there."""
    text = experiment.read_text().replace("components = 4", "components = 500")
    experiment.write_text(text)
    run = tmp_path / "run"
    here = [str(experiment), "--out", str(run), "--quiet"]
    assert main(["generate", *here]) == 0
    assert main(["train", *here]) == 1
    assert "principal components are asked for" in capsys.readouterr().err
    assert not list((run / "internal").glob("*"))
