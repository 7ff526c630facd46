"""The path of `make demo` at toy size: body, truth on two ranks, training, simulation, report; 2D and 3D."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.toy_experiment import write_experiment


@pytest.mark.slow
def test_from_mesh_to_report(softprint, tmp_path, dim):
    experiment = write_experiment(tmp_path, dim)
    run = tmp_path / "run"
    steps = [
        (("body",), 1),
        (("generate",), 2),
        (("train",), 1),
        (("simulate", *(f"--model={name}" for name in ("full", "bare", "thesis5", "mechanics", "ours"))), 1),
        (("report",), 1),
    ]
    for (verb, *options), ranks in steps:
        done = softprint(verb, experiment, "--out", run, "--quiet", *options, ranks=ranks)
        assert done.returncode == 0, f"{verb}: {done.stdout}\n{done.stderr}"
    made = {path.relative_to(run).as_posix() for path in run.rglob("*") if path.is_file()}
    assert {"body.h5", "truth.h5", "report.html", "report.json"} <= made
    assert {f"corrections/{model}.safetensors" for model in ("thesis5", "mechanics", "ours")} <= made
    assert {
        f"motions/held_out_{model}.h5" for model in ("full", "bare", "thesis5", "mechanics", "ours")
    } <= made
    left_over = {name for name in made if Path(name).name.startswith(".") or name.endswith(".shard")}
    assert left_over <= {".generate.lock"}

    # Every number in the report is a number: nothing was divided by an empty set.
    def numbers(value):
        if isinstance(value, dict):
            for item in value.values():
                yield from numbers(item)
        elif isinstance(value, list):
            for item in value:
                yield from numbers(item)
        elif isinstance(value, float):
            yield value

    report = json.loads((run / "report.json").read_text())
    assert np.isfinite(list(numbers(report))).all()

    # A second time everything is there already, and stays byte for byte.
    before = (run / "truth.h5").read_bytes()
    for (verb, *options), ranks in steps[:4]:
        assert softprint(verb, experiment, "--out", run, "--quiet", *options, ranks=ranks).returncode == 0
    assert (run / "truth.h5").read_bytes() == before
