"""The scripts in examples/, each run as it stands, in a folder with a finished run of their experiment."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softprint

REPOSITORY = Path(__file__).resolve().parent.parent
SCRIPTS = sorted((REPOSITORY / "examples").glob("*.py"))
TOP = 0.06  # m


@pytest.fixture
def run_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The run directory of the examples, empty, in the present folder."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs" / "jelly3d_small"
    folder.mkdir(parents=True)
    return folder


@pytest.fixture
def block(run_folder: Path) -> None:
    """A block of 1,600 tetrahedra in the place of the Jelly."""
    mesh = softprint.box_mesh([-0.05, -0.05, 0.0], [0.05, 0.05, TOP], [8, 8, 5])
    handles = softprint.place_handles(
        mesh, 8, [softprint.frame_in_box(mesh, "base", [[-1, -1, -1], [1, 1, 0.013]])]
    )
    material = softprint.make_material("stable_neo_hookean", 2e4, 0.4)
    softprint.save_body(
        run_folder / "body.h5", softprint.assemble_body(mesh, handles, material, 1000.0, name="block")
    )


def play(name: str) -> dict[str, Any]:
    """What is known at the end of a script."""
    return runpy.run_path(str(REPOSITORY / "examples" / name))


def test_examples_use_the_public_name_only():
    assert len(SCRIPTS) == 6
    for script in SCRIPTS:
        text = script.read_text()
        assert "import softprint\n" in text
        assert "softprint." in text
        assert "softprint.runtime" not in text
        assert text.startswith("# %% [markdown]\n")


@pytest.mark.usefixtures("block")
def test_the_control_loop_holds_its_force():
    session = play("control_loop.py")
    # The loop integrates the error away; what is left is the tolerance of two Newton iterations.
    assert session["force"] == pytest.approx(session["target"], rel=0.02)


@pytest.mark.usefixtures("block")
def test_the_dropped_ball_is_kicked():
    # It comes to rest in half a second, and flies for a sixth of one after a kick.
    assert play("drop_loop.py")["kicks"] >= 1


@pytest.mark.usefixtures("block")
def test_the_skin_feels_the_drag():
    touch = play("touch_loop.py")["touch"]
    assert touch.pressure[1] > 1000  # Pa, in the middle
    assert touch.traction[1, 0] > 0.02 * touch.pressure[1]  # and dragged along


@pytest.mark.usefixtures("block")
def test_a_stored_state_branches_and_replays():
    session = play("stored_states.py")
    assert session["same"]
    assert session["lifted"].contacts["ball"].points == 0
    force = session["dragged"].contacts["ball"].force
    assert force[2] > 0.1  # N: still pressed in
    assert force[0] < -0.1 * force[2]  # and held back, by friction and by the slope of the dent


def test_the_tactile_environment_reaches_its_force():
    session = play("tactile_environment.py")
    assert session["success"]
    assert session["info"]["force"] == pytest.approx(session["wanted"], rel=0.05)  # the tolerance of the task
    assert session["moved"] > 0.02  # mm: the markers give way


def test_learned_contact_plays_beside_the_reduced_model(finished_run: Path, run_folder: Path):
    run_folder.rmdir()
    run_folder.symlink_to(finished_run / "run")
    examples = run_folder.parent.parent / "examples"
    examples.symlink_to(finished_run)
    (finished_run / "jelly3d_small.toml").write_text((finished_run / "toy.toml").read_text())
    session = play("learned_contact.py")
    (name,) = session["our_result"].contacts
    bare, ours = (session[result].contacts[name].force for result in ("bare_result", "our_result"))
    # Pressed 5 mm in: both push back, the one with mechanics less, because it gives way under the collider.
    assert np.linalg.norm(bare) > np.linalg.norm(ours) > 0.1
    assert 1e-4 < max(session["differences"]) < 5e-3
