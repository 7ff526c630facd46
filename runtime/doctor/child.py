"""Run checks in child processes: a library that they load may crash, and must not stay loaded."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

TIMEOUT = 120.0  # s: the first import of PyTorch or VTK from a cold disk takes tens of seconds


@dataclass(frozen=True)
class ChildResult:
    """succeeded: exit status 0 in time; output: what it printed; complaint: the last line on stderr, or the reason why
    it ended.
    """

    succeeded: bool
    output: str
    complaint: str


def run_python(code: str, environment: Mapping[str, str] | None = None) -> ChildResult:
    """Run Python code in a child process."""
    return run_command([sys.executable, "-c", code], environment)


def run_command(command: Sequence[str], environment: Mapping[str, str] | None = None) -> ChildResult:
    """Run a command with additions to the environment."""
    try:
        result = subprocess.run(
            command,
            env={**os.environ, **(environment or {})},
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except FileNotFoundError:
        return ChildResult(False, "", f"{command[0]} is not there")
    except subprocess.TimeoutExpired:
        return ChildResult(False, "", f"no answer within {TIMEOUT:.0f} s")
    lines = result.stderr.strip().splitlines()
    complaint = lines[-1] if lines else f"exit status {result.returncode}"
    if result.returncode < 0:
        complaint = f"ended by signal {-result.returncode}"
    return ChildResult(result.returncode == 0, result.stdout.strip(), complaint)
