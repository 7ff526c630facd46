"""Threads of linear algebra: one in commands that play scenes, unless the environment says otherwise; how they wait."""

import os
import subprocess
import sys

import pytest

from softprint.runtime.linalg.one_thread import VARIABLES
from softprint.runtime.linalg.openmp_waiting import wait_briefly

SCRIPT = """
import numpy
from softprint.runtime.linalg.one_thread import blas_threads, one_thread_by_default
before = blas_threads()
one_thread_by_default()
print(before, blas_threads())
"""


def threads(**environment: str) -> list[int]:
    """Before and after, in a process of its own: the limit holds for all that follows."""
    others = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    command = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, env={**others, **environment}, capture_output=True, text=True, check=True)
    return [int(word) for word in done.stdout.split()]


def test_one_by_default():
    assert threads()[1] == 1


@pytest.mark.parametrize("name", VARIABLES)
def test_the_environment_has_the_last_word(name):
    before, after = threads(**{name: "2"})
    assert after == before


@pytest.mark.parametrize(
    ("given", "found"),
    [({}, "1000"), ({"GOMP_SPINCOUNT": "7"}, "7"), ({"OMP_WAIT_POLICY": "ACTIVE"}, None)],
)
def test_threads_wait_briefly_unless_the_environment_says_how(monkeypatch, given, found):
    monkeypatch.setattr(os, "environ", dict(given))
    wait_briefly()
    assert os.environ.get("GOMP_SPINCOUNT") == found


def test_torch_is_loaded_after_the_command_line_has_said_so():
    """What OpenMP finds in the environment when it is loaded counts."""
    script = "import sys, softprint.runtime.cli.main; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
