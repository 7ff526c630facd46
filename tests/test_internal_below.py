"""Corrections of contact on an internal correction of the body, by the command line alone: each form, from training to
the report; and what contact makes of the corrected surface."""

from __future__ import annotations

import json

import numpy as np
import pytest

from softprint.runtime.body.body_file import load_body
from softprint.runtime.cli.main import main
from softprint.runtime.experiment import load_experiment
from softprint.runtime.learned.correction_file import read_header
from softprint.runtime.scenes.corrected_body import body_below
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.playing import build_model
from softprint.runtime.viewer.session.workshop import Workshop
from tests.toy_experiment import write_experiment

MODELS = """
[[training.models]]
name = "mechanics"
learned = false
added_to = "own"
[[training.models]]
name = "plain"
learned = false
[[training.models]]
name = "ours"
hidden = [8, 8]
added_to = "own"
[[training.models]]
name = "field"
form = "thesis5"
hidden = [8, 8]
added_to = "own"
[[training.models]]
name = "settled"
form = "thesis5"
hidden = [8, 8]
added_to = "condensed"
[[training.models]]
name = "alone"
form = "thesis5"
hidden = [8, 8]
[[training.internal]]
name = "own"
on = "condensation"
hidden = [8, 8]
components = 3
steps = 50
"""
NAMES = ("mechanics", "plain", "ours", "field", "settled")


def written(folder, models=MODELS):
    """The toy experiment in the plane with these models alone, without gravity."""
    experiment = write_experiment(folder, 2)
    text = experiment.read_text().replace("[0, -9.81]", "[0, 0]").replace("states = 3", "states = 12")
    before, rest = text.split("[[training.models]]", 1)
    experiment.write_text(before + models + rest[rest.index("[body.handles]") :])
    return experiment


@pytest.mark.slow
def test_every_form_on_an_internal_correction(tmp_path, capsys):
    path, run = written(tmp_path), tmp_path / "run"
    here = [str(path), "--out", str(run), "--quiet"]
    assert main(["generate", *here]) == 0
    assert main(["train", *here]) == 0
    everyone = [word for name in ("full", "bare", "own", *NAMES, "plain+own") for word in ("--model", name)]
    assert main(["simulate", *here, *everyone]) == 0
    assert main(["report", *here, "--no-pictures"]) == 0
    assert main(["bench", *here, "--model", "plain+own", "--steps", "1", "--scene", "held_out"]) == 0
    errors = json.loads((run / "report.json").read_text())["errors"]
    assert 0.0 < errors["ours"]["relative_rms"] < 1.0

    motions = {name: load_motion(run / "motions" / f"held_out_{name}.h5") for name in NAMES}
    for name in ("mechanics", "plain", "ours"):  # the fields are rough after 50 steps of training
        assert motions[name].converged.all(), name
    last = motions["plain"].n_frames - 1
    assert motions["plain"].in_contact[last]
    # The internal correction moves the body on which contact acts: other states, other forces.
    moved = np.abs(motions["mechanics"].rows[last] - motions["plain"].rows[last]).max()
    assert moved > 1e-7
    forces = [motions[name].colliders["disc"].force[last] for name in ("mechanics", "plain")]
    assert not np.allclose(*forces, rtol=1e-4)

    # What is drawn is the state, settled, with the displacement by contact, and nothing twice.
    experiment, body = load_experiment(path), load_body(run / "body.h5")
    (scene,) = (own for own in experiment.scenes if own.name == "held_out")
    internal = body_below(body, run, "own", np.zeros(2)).internal
    player = build_model(experiment, body, scene, run, "mechanics")
    away = player.start().state
    expected = body.reduced_positions(away.rows) + internal.bind().displacement(away.rows)
    mechanics = player._simulator.mechanics  # the colliders are far away at the start
    expected += mechanics.condensation.corotated(away.frame).displacement(away.rows)
    np.testing.assert_allclose(player.positions(away), expected, atol=1e-12)

    # Contact that was trained without the internal correction, played on it, is that of mechanics trained on it.
    joint = load_motion(run / "motions" / "held_out_plain+own.h5")
    np.testing.assert_allclose(joint.rows, motions["mechanics"].rows, atol=1e-9)
    np.testing.assert_allclose(joint.positions(last), motions["mechanics"].positions(last), atol=1e-9)
    assert errors["plain+own"]["relative_rms"] == pytest.approx(errors["mechanics"]["relative_rms"], rel=1e-6)
    assert "plain+own" in Workshop(experiment, body, scene, run).names

    for name, words in (
        ("plain+", "are expected beside the +"),
        ("plain+nothing", "nothing.safetensors"),
        ("nobody+own", "there is no model 'nobody'"),
        ("mechanics+other", "trained on the internal correction 'own'"),
        ("alone+own", "displacement field"),
    ):
        capsys.readouterr()
        assert main(["simulate", *here, "--model", name]) == 1, name
        said = capsys.readouterr().err
        assert words in said, said
        assert "Traceback" not in said

    # Training again with another internal correction below is another training.
    kept = (run / "corrections" / "ours.safetensors").read_bytes()
    assert main(["train", *here]) == 0
    assert (run / "corrections" / "ours.safetensors").read_bytes() == kept
    assert read_header(run / "corrections" / "ours.safetensors").added_to == "own"
    path.write_text(path.read_text().replace("components = 3", "components = 2"))
    assert main(["train", *here]) == 0
    assert (run / "corrections" / "ours.safetensors").read_bytes() != kept

    (run / "internal" / "own.safetensors").unlink()
    for verb in (("train", "--model", "ours"), ("simulate", "--model", "ours", "--no-resume")):
        capsys.readouterr()
        assert main([verb[0], *here, *verb[1:]]) == 1
        said = capsys.readouterr().err
        assert "own" in said, said
        assert "Traceback" not in said


ON_MODES = """
[[training.models]]
name = "mechanics"
learned = false
static_condensation = false
added_to = "own"
[[training.models]]
name = "field"
form = "thesis5"
hidden = [8, 8]
added_to = "own"
[[training.internal]]
name = "own"
equilibrium = true
components = 5
cubature = 60
"""


def test_contact_on_modes_in_equilibrium(tmp_path):
    """Condensed contact and a field, from training to motions; with condensed contact steps converge fast."""
    path, run = written(tmp_path, ON_MODES), tmp_path / "run"
    here = [str(path), "--out", str(run), "--quiet"]
    assert main(["generate", *here]) == 0
    assert main(["train", *here]) == 0
    everyone = [word for name in ("own", "mechanics", "field") for word in ("--model", name)]
    assert main(["simulate", *here, *everyone]) == 0
    for name in ("own", "mechanics"):
        motion = load_motion(run / "motions" / f"held_out_{name}.h5")
        # All steps; the start is settled to a hundredth of their tolerance, which modes of few samples need not reach.
        assert motion.converged[1:].all(), name
        assert motion.in_contact[motion.n_frames - 1]
        assert motion.iterations.mean() < 8, name


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('hidden = [8, 8]\nadded_to = "own"', 'added_to = "other"', "other"),
        ('hidden = [8, 8]\nadded_to = "own"', 'added_to = "condensed"', "has by itself"),
        ('on = "condensation"', 'on = "subspace"', "static_condensation"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, before, after, message, capsys):
    path = written(tmp_path, MODELS.replace(before, after, 1))
    assert main(["train", str(path), "--out", str(tmp_path / "run"), "--quiet"]) == 1
    said = capsys.readouterr().err
    assert message in said, said
    assert "Traceback" not in said
