"""Tables 4.1 and 5.1 of the thesis for runs on this machine: size, data, error and steps per second of every body.

    softprint run examples/worm_small.toml
    python -m reproduction.body_tables runs/worm_small [RUN ...]

Reads the report of each run. A table in Markdown:

    handles                points and frames
    samples                usable ones, and states; with core-seconds of a sample
    mechanics, ours        error left on the test scenes, over that of the bare subspace
    linear, full, ours     steps in a second while in contact, of the bare subspace, full space and ours
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError

COLUMNS = ("run", "cells", "handles", "samples", "mechanics", "ours", "linear", "full", "ours, steps/s")


def report_of(run: Path) -> dict[str, Any]:
    """The numbers of a report. Raises SoftprintError where there is none."""
    path = run / "report.json"
    if not path.is_file():
        raise SoftprintError(f"{path} does not exist: make it with `softprint run` or `softprint report`")
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def cells(run: Path) -> list[str]:
    """One line of the table."""
    report = report_of(run)
    body, truth, errors, timings = (report[key] for key in ("body", "truth", "errors", "timings"))
    samples = ""
    if truth:
        samples = f"{truth['usable']:,}, {truth['states']} ({truth['seconds_per_sample']:.3f} s)"
    left = [f"{errors[name]['relative_rms']:.1%}" if name in errors else "" for name in ("mechanics", "ours")]
    speeds = [
        f"{timings[name]['steps_per_second']:.1f}" if name in timings else ""
        for name in ("bare", "full", "ours")
    ]
    handles = f"{body['points']}/{body['frames']}"
    return [run.name, f"{body['cells']:,}", handles, samples, *left, *speeds]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN")
    given = parser.parse_args()
    try:
        rows = [cells(run) for run in given.runs]
    except SoftprintError as error:
        parser.error(str(error))
    for row in (COLUMNS, ["---"] * len(COLUMNS), *rows):
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    run_script(main)
