"""`softprint run`: how far its steps are, from what their processes tell, and on how many ranks."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from softprint.runtime.cli import run_steps
from softprint.runtime.cli.progress import FOLLOWED, Progress, tell_failure
from softprint.runtime.cli.run_steps import Step, how_far, usable_ranks, why_failed
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.forked_workers import worker_count


def test_a_process_tells_how_far_it_is(tmp_path, monkeypatch):
    told = tmp_path / "told"
    monkeypatch.setenv(FOLLOWED, str(told))
    step = Step("simulate", 0.2, counted=("steps",), bars=2)
    assert how_far("", step) == (0.0, "")
    with Progress(10, "files", "reading", quiet=True):
        pass
    assert how_far(told.read_text(), step) == (0.0, "(reading, 0/10 files)")
    for scene, share in (("a", 0.5), ("b", 1.0)):
        with Progress(4, "steps", scene, quiet=True) as bar:
            bar.update(4)
        assert how_far(told.read_text(), step) == (share, f"({scene}, 4/4 steps)")
    with Progress(4, "steps", "silent", quiet=True, silent=True) as bar:
        bar.update(1)
    assert "silent" not in told.read_text()


def test_the_bar_of_training_ends_with_its_last_network(tmp_path, monkeypatch):
    """One network of thesis5, four on parts of the samples and one on all of ours, none of linear mechanics."""
    told = tmp_path / "told"
    monkeypatch.setenv(FOLLOWED, str(told))
    experiment = load_experiment(Path(__file__).resolve().parents[3] / "examples" / "jelly3d_small.toml")
    _, _, step, *_ = run_steps.steps_of(SimpleNamespace(experiment=experiment), ranks=1)
    shares = []
    for name in ("thesis5", *(f"ours, part {k} of 4" for k in range(1, 5)), "ours, all samples"):
        with Progress(4, "step", f"training {name}", quiet=True) as bar:
            bar.update(4)
        shares.append(how_far(told.read_text(), step)[0])
    assert shares == pytest.approx(np.arange(1, 7) / 6)


def test_why_a_process_failed_is_found_among_lines_of_mpi(tmp_path, monkeypatch):
    """The first reason that was told: other ranks may fail because the first one has."""
    told = tmp_path / "told"
    monkeypatch.setenv(FOLLOWED, str(told))
    with Progress(4, "contacts", "truth", quiet=True) as bar:
        bar.update(1)
    assert why_failed(told.read_text()) == ""
    tell_failure("truth.h5 contains finished work\nof a different experiment")
    tell_failure("rank 1: stopped")
    assert why_failed(told.read_text()) == "truth.h5 contains finished work of a different experiment"


def test_ranks(monkeypatch):
    monkeypatch.setattr(run_steps.shutil, "which", lambda name: None)
    assert usable_ranks(None) == 1
    with pytest.raises(SoftprintError, match="needs mpirun"):
        usable_ranks(2)
    monkeypatch.setattr(run_steps.shutil, "which", lambda name: "/usr/bin/mpirun")
    assert usable_ranks(3) == 3
    with pytest.raises(SoftprintError, match="at least 1"):
        usable_ranks(0)


@pytest.mark.parametrize(("told", "workers"), [(None, 8), ("3", 3)])
def test_training_and_the_report_use_all_cores_or_as_many_as_are_told(monkeypatch, tmp_path, told, workers):
    """As they find it in the environment that `run` gives them, in which BLAS has one thread."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)))
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if told is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", told)
    experiment = load_experiment(Path(__file__).resolve().parents[3] / "examples" / "jelly3d_small.toml")
    environments = {
        step.verb: run_steps._environment(step, tmp_path / "told")
        for step in run_steps.steps_of(SimpleNamespace(experiment=experiment), ranks=2)
    }
    found = {}
    for verb, environment in environments.items():
        monkeypatch.setenv("OMP_NUM_THREADS", environment["OMP_NUM_THREADS"])
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", environment["OPENBLAS_NUM_THREADS"])
        found[verb] = worker_count(100)
    assert found == {"body": 1, "generate": 1, "train": workers, "simulate": 1, "report": workers}
