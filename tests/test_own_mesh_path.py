"""The whole way of a mesh of one's own at toy size: `softprint new`, then `softprint run`, which can be stopped and
goes on."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from softprint.runtime.experiment import load_experiment

TOY = {
    "sampling.states": "3",
    "sampling.places": "2",
    "sampling.rotations": "2",
    "sampling.depths": "2",
    "sampling.repeat_share": "0.2",
    "training.steps": "20",
    "report.frames": "1",
    "dynamics.time_step": "0.05",
}
SOLID = {
    "sampling.test_places": "1",
    "library.resolution": "12",
    "library.shapes": "['ball', 'cushion', 'pear', 'torus']",
}


def toy(settings):
    return [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]


@pytest.mark.slow
def test_from_a_surface_to_a_report(softprint, tmp_path):
    pear = trimesh.creation.icosphere(subdivisions=3, radius=30.0)
    pear.vertices[:, 2] *= 1.0 + 0.004 * pear.vertices[:, 2]  # no symmetry that would hide a mistake
    pear.export(tmp_path / "my pear.stl")
    made = softprint("new", "my pear.stl", "--units", "mm", "--cells", "500", "--out", "pear.toml", "--quiet")
    assert made.returncode == 0, made.stderr
    options = ("--out", "run", "--ranks", "2", "--no-pictures", "--quiet", *toy(TOY | SOLID))
    done = softprint("run", "pear.toml", *options, timeout=900)
    assert done.returncode == 0, done.stderr + (tmp_path / "run" / "run.log").read_text()
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert {"bare", "mechanics", "ours"} <= set(report["errors"])
    for model in ("mechanics", "ours"):
        # What mechanics leaves of the error on any mesh is less than all of it.
        assert 0.0 < report["errors"][model]["relative_rms"] < 1.0
        assert f"{model} " in done.stdout
    assert "report.html" in done.stdout


@pytest.mark.slow
def test_from_an_outline_to_a_report(softprint, tmp_path):
    (tmp_path / "leaf.txt").write_text("0 0\n30 -8\n70 0\n80 30\n50 55\n15 40\n")
    made = softprint("new", "leaf.txt", "--scale", "0.001", "--cells", "400", "--quiet")
    assert made.returncode == 0, made.stderr
    assert load_experiment(tmp_path / "leaf.toml").dim == 2
    whole = ("run", "leaf.toml", "--ranks", "1", "--no-pictures", "--quiet", *toy(TOY))
    done = softprint(*whole, timeout=900)
    assert done.returncode == 0, done.stderr
    run = tmp_path / "runs" / "leaf"
    assert "data:image/webp" not in (run / "report.html").read_text()
    report = json.loads((run / "report.json").read_text())
    assert np.isfinite([row["relative_rms"] for row in report["errors"].values() if row]).all()
    # The same command again keeps everything that does not have to be made again.
    kept = [run / name for name in ("body.h5", "truth.h5", "corrections/ours.safetensors")]
    before = [path.read_bytes() for path in kept]
    assert softprint(*whole, timeout=900).returncode == 0
    assert [path.read_bytes() for path in kept] == before


def test_a_step_that_fails_says_why(softprint, tmp_path):
    (tmp_path / "leaf.txt").write_text("0 0\n30 -8\n70 0\n80 30\n50 55\n15 40\n")
    assert softprint("new", "leaf.txt", "--scale", "0.001", "--cells", "200").returncode == 0
    failed = softprint("run", "leaf.toml", "--set", "body.handles.points=5000", "--quiet")
    assert failed.returncode == 1
    assert len(failed.stderr.strip().splitlines()) == 1
    assert "softprint body: " in failed.stderr
    assert "5000 points" in failed.stderr
