"""The notebooks in examples/notebooks, each run from its first cell to its last."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from tests.notebook import cells, run_notebook
from tests.runtime.convert.gltf_reader import Gltf
from tests.toy_experiment import write_experiment

REPOSITORY = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((REPOSITORY / "examples" / "notebooks").glob("*.ipynb"))
GIF = '<img src="data:image/gif;base64,'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a notebook runs: a folder beside the examples, with a run directory as the repository has it."""
    matplotlib.use("agg")
    examples = tmp_path / "examples"
    examples.mkdir()
    for path in (REPOSITORY / "examples").glob("*.toml"):
        (examples / path.name).symlink_to(path)
    (tmp_path / "meshes").symlink_to(REPOSITORY / "meshes")
    here = examples / "notebooks"
    here.mkdir()
    monkeypatch.chdir(here)
    return here


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_stored_without_results(notebook: Path):
    content = json.loads(notebook.read_text())
    assert (content["nbformat"], content["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in content["cells"]]
    assert len(set(ids)) == len(ids)
    for cell in content["cells"]:
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
    assert "softprint.runtime" not in "".join(cells(notebook))
    assert cells(notebook, "markdown")[0].startswith("# ")


def test_the_ball_is_pressed_in(folder: Path):
    known, shown = run_notebook(REPOSITORY / "examples" / "notebooks" / "press_a_ball.ipynb")
    still, film, pressed, files = shown
    assert still[:4] == pressed[:4] == b"\x89PNG"
    assert film.startswith(GIF)
    assert "press_a_ball.glb" in files
    assert Gltf(folder / "press_a_ball.glb").primitive("body")["targets"]
    forces = np.array(known["forces"])
    assert forces.argmax() in (29, 30)  # the deepest steps
    assert forces[0] == forces[-1] == 0.0


def test_the_motions_of_a_run_are_compared(folder: Path, capsys: pytest.CaptureFixture[str]):
    from softprint.runtime.cli import main

    run = folder.parent.parent / "runs" / "jelly3d_small"
    experiment = write_experiment(folder, 3)
    for verb, *options in (["body"], ["simulate", "--model=bare"]):
        assert main.main([verb, str(experiment), "--out", str(run), "--quiet", *options]) == 0
    notebook = REPOSITORY / "examples" / "notebooks" / "compare_models.ipynb"
    _, shown = run_notebook(notebook)
    assert [text.startswith(GIF) for text in shown] == [True, True]
    assert "no motion of the model full" in capsys.readouterr().out
    # The same motion under the name of full space: nothing is off.
    motions = run / "motions"
    shutil.copy(motions / "held_out_bare.h5", motions / "held_out_full.h5")
    known, _ = run_notebook(notebook)
    assert max(known["off"]) == 0.0
    assert "bare: 0.000 mm on average" in capsys.readouterr().out


def test_the_sensors_feel_the_ball_pass(folder: Path):
    known, shown = run_notebook(REPOSITORY / "examples" / "notebooks" / "touch_signals.ipynb")
    assert shown[0].startswith(GIF)
    pressure, shear = known["pressure"], known["shear"]
    assert pressure[0].max() == 0.0
    assert (pressure.max(axis=0) > 1e3).any()
    # Dragged to the right, the ball is over the right sensor last.
    assert pressure[:, 2].argmax() > pressure[:, 0].argmax()
    assert shear.max() > 0.0
