"""Reports of many bodies in one table."""

from __future__ import annotations

import json

import pytest

from fem_truth.report.gather import gather, table_lines
from fem_truth.report.report_json import REPORT_VERSION
from runtime.errors import SoftprintError

ROW = {
    "squared": 0.04,
    "rms": 0.2,
    "whole_squared": 0.01,
    "whole_rms": 0.1,
    "worst": 0.9,
    "samples": 60,
    "median": 0.1,
}


def write_report(folder, name: str, **changed) -> None:
    folder.mkdir()
    speeds = [
        {"model": model, "frames_per_second": rate} for model, rate in (("bare", 200.0), ("ours", 100.0))
    ]
    report = {
        "softprint_report": REPORT_VERSION,
        "experiment": {"name": name},
        "body": {"points": 7, "frames": 2, "cells": 31218, "nodes": 6000},
        "shapes": {
            "judged": "ours",
            "sides": {"ours": {"learned": ROW, "testing": ROW}},
            "contacts": {"learned": 12},
        },
        "truth": {"states": 1, "noise_floor": 3e-4},
        "benchmarks": [{"name": "bench", "rows": speeds}],
        "timings": {},
        "machine": {"cores": 2},
    }
    (folder / "report.json").write_text(json.dumps({**report, **changed}))


def test_one_line_a_body_with_the_thesis_beside_it(tmp_path):
    write_report(tmp_path / "finger", "finger_small")
    write_report(tmp_path / "cube", "cube", timings={"full": {"steps_per_second": 5.0}}, benchmarks=[])
    summary = gather([tmp_path / "finger", tmp_path / "cube"], tmp_path / "all.html")
    finger, cube = summary["rows"]
    assert finger["thesis"]["test"] == 0.155
    assert finger["report"] == "finger/report.html"
    assert cube["thesis"] is None
    assert finger["speeds"] == {
        "bare": 200.0,
        "full": None,
        "ours": 100.0,
        "cost_of_bare": 2.0,
        "faster_than_full": None,
    }
    assert cube["speeds"]["full"] == 5.0
    assert json.loads((tmp_path / "all.json").read_text()) == summary
    page = (tmp_path / "all.html").read_text()
    assert page.count("finger_small") >= 2
    assert "15.5" in page
    lines = table_lines(summary)
    assert len(lines) == 4
    assert "| 1 %, 1 % | 14 %, 15.5 % | 4 % (20 %) | 4 % (20 %) | 0.03 % | 200, -, 100 |" in lines[2]


@pytest.mark.parametrize(
    ("changed", "words"),
    [({"shapes": None}, "shapes never seen"), ({"softprint_report": 0}, "not a report of this version")],
)
def test_a_run_that_cannot_be_gathered_is_refused(tmp_path, changed, words):
    write_report(tmp_path / "run", "finger", **changed)
    with pytest.raises(SoftprintError, match=words):
        gather([tmp_path / "run"], tmp_path / "all.html")
    assert not (tmp_path / "all.html").exists()
    with pytest.raises(SoftprintError, match="is not there"):
        gather([tmp_path / "absent"], tmp_path / "all.html")
