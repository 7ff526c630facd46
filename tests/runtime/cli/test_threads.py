"""Threads of linear algebra in commands that play scenes: one, unless the environment says otherwise."""

import os
import subprocess
import sys

import pytest

from softprint.runtime.linalg.one_thread import VARIABLES

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
