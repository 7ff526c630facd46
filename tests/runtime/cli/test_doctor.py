"""The checks of `softprint doctor`: each detects its problem and says how to fix it."""

from __future__ import annotations

import os

import pytest

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verbs.doctor_verb import VERB
from softprint.runtime.doctor import Finding, Level, parallel, speed, versions
from softprint.runtime.doctor.child import ChildResult, run_command, run_python


def test_exit_statuses_of_child_processes_are_reported():
    assert run_python("print(5)") == ChildResult(True, "5", "exit status 0")
    assert run_python("raise SystemExit('no luck')").complaint == "no luck"
    assert run_python("import os; os.abort()").complaint == "ended by signal 6"
    assert run_command(["no-such-program"]).complaint == "no-such-program is not there"


def test_what_is_fatal():
    assert not Finding("x", Level.MISSING, "").is_fatal
    assert Finding("x", Level.MISSING, "", needed=True).is_fatal
    assert Finding("x", Level.BROKEN, "").is_fatal
    assert not Finding("x", Level.WARN, "", needed=True).is_fatal


def test_libraries_missing_and_broken(monkeypatch, tmp_path):
    (tmp_path / "cracked.py").write_text("raise RuntimeError('cracked')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(
        versions,
        "LIBRARIES",
        (
            versions.Library("numpy", "arrays", "get it", needed=True),
            versions.Library("moon_cheese", "dinner", "fly there", needed=True),
            versions.Library("cracked", "nothing", "mend it"),
        ),
    )
    good, missing, broken = versions.check_libraries()
    assert good.level is Level.OK
    assert missing.is_fatal
    assert (missing.detail, missing.remedy) == ("for dinner", "fly there")
    assert broken.level is Level.BROKEN
    assert "cracked" in broken.detail


@pytest.mark.parametrize("check", [speed.check_numpy_blas, speed.check_scipy_blas])
def test_blas_is_measured(check):
    finding = check()
    assert finding.level in (Level.OK, Level.WARN)
    assert "GFLOP/s on one core" in finding.detail


def test_slow_blas_is_reported(monkeypatch):
    monkeypatch.setattr(speed, "run_python", lambda *_: ChildResult(True, "4.9 libblas.so.3", ""))
    finding = speed.check_scipy_blas()
    assert finding.level is Level.WARN
    assert "apt-get install libopenblas0-serial" in finding.remedy


@pytest.mark.parametrize(
    ("threads", "level"), [(None, Level.OK), ("1", Level.OK), ("100000", Level.WARN), ("all", Level.WARN)]
)
def test_threads(monkeypatch, threads, level):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if threads:
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
    assert speed.check_threads().level is level


def test_an_hdf5_conflict_is_reported(monkeypatch):
    monkeypatch.setattr(parallel, "find_spec", lambda name: name)
    monkeypatch.setattr(
        parallel, "run_python", lambda code: ChildResult("dolfinx, h5py" not in code, "", "crashed")
    )
    finding = parallel.check_h5py_beside_dolfinx()
    assert finding.level is Level.BROKEN
    assert finding.detail == "dolfinx first: crashed"
    assert "python3-h5py" in finding.remedy


def test_root_gets_instructions_for_mpi(monkeypatch):
    monkeypatch.setattr(parallel, "find_spec", lambda name: name)
    monkeypatch.setattr(parallel.shutil, "which", lambda name: name)
    monkeypatch.setattr(os, "getuid", lambda: 0)
    answers = [ChildResult(False, "", "will not run as root"), ChildResult(True, "2 Open MPI v4", "")]
    monkeypatch.setattr(parallel, "run_command", lambda *_: answers.pop(0))
    finding = parallel.check_mpi()
    assert finding.level is Level.WARN
    assert "OMPI_ALLOW_RUN_AS_ROOT=1" in finding.remedy


def test_h5py_and_dolfinx_are_compatible_here():
    assert parallel.check_h5py_beside_dolfinx().level is Level.OK


@pytest.mark.parametrize(("level", "status"), [(Level.OK, 0), (Level.WARN, 0), (Level.BROKEN, 1)])
def test_verb_prints_remedies_and_ends_with_a_status(monkeypatch, level, status):
    monkeypatch.setattr(
        "softprint.runtime.doctor.examine", lambda: [Finding("jelly", level, "wobbles", "chill it")]
    )
    lines: list[str] = []
    assert VERB.run(None, Context(write=lines.append)) == status
    assert ("chill it" in "\n".join(lines)) == (level is not Level.OK)
