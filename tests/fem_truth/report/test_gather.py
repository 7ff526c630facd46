"""Reports of many bodies on one page."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

from softprint.fem_truth.report.drawing.picture import encode
from softprint.fem_truth.report.gather import gather, table_lines
from softprint.fem_truth.report.page import look_up
from softprint.fem_truth.report.report_json import REPORT_VERSION
from softprint.runtime.errors import SoftprintError
from tests.page_reader import Reader

ROW = {
    "squared": 0.04,
    "rms": 0.2,
    "whole_squared": 0.01,
    "whole_rms": 0.1,
    "worst": 0.9,
    "samples": 60,
    "median": 0.1,
}

SCENE = {
    "name": "press",
    "n_contact": 9,
    "errors_all": {
        model: {"rms": 1e-3 * left, "relative_rms": left, "relative_worst": 1.5 * left}
        for model, left in (("full", 0.0), ("bare", 1.0), ("mechanics", 0.5), ("ours", 0.25))
    },
    "free": {
        model: {"rms": 2e-3 * left, "relative": left, "not_converged": 3}
        for model, left in (("bare", 1.0), ("ours", 1.25))
    },
}


def write_report(folder, name: str, **changed) -> None:
    folder.mkdir()
    report = {
        "softprint_report": REPORT_VERSION,
        "experiment": {"name": name},
        "body": {"points": 7, "frames": 2, "cells": 31218, "nodes": 6000},
        "shapes": {
            "judged": "ours",
            "sides": {name: {"learned": ROW, "testing": ROW} for name in ("mechanics", "ours")},
            "contacts": {"learned": 12},
            "shapes": {"ours": {"wood_screw": ROW, "torus": ROW}},
            "worst": [{"shape": "wood_screw"}],
        },
        "scenes": [SCENE, {"name": "aside", "n_contact": 0, "errors_all": {}, "free": {}}],
        "truth": {"states": 1, "noise_floor": 3e-4, "noise_90": 2e-3},
        "timings": {"ours": {"steps_per_second": 77.0}},
    }
    (folder / "report.json").write_text(json.dumps({**report, **changed}))


def write_bench(folder, **changed) -> None:
    """Ours is half as fast as the bare subspace, and one step in four does not converge."""
    speeds = [
        {
            "model": model,
            "steps": 8,
            "frames_per_second": rate,
            "mean": 1 / rate,
            "p95": 3 / rate,
            "median": 0.5 / rate,
            "converged": done,
        }
        for model, rate, done in (("bare", 200.0, 1.0), ("ours", 100.0, 0.75))
    ]
    bench = {
        "scene": "press",
        "iterations": 40,
        "tolerance": 1e-6,
        "cores_used": 2,
        "machine": {"processor": "a CPU", "cores": 2},
        "speeds": speeds,
    }
    (folder / "bench.json").write_text(json.dumps({**bench, **changed}))


def test_one_row_per_body_with_the_results_of_the_thesis(tmp_path):
    write_report(tmp_path / "finger", "finger_small")
    write_bench(tmp_path / "finger")
    write_report(tmp_path / "cube", "cube")
    summary = gather([tmp_path / "finger", tmp_path / "cube"], tmp_path / "all.html")
    finger, cube = summary["rows"]
    assert finger["thesis"]["test"] == 0.155
    assert finger["report"] == "finger/report.html"
    assert cube["thesis"] is None
    assert json.loads((tmp_path / "all.json").read_text()) == summary
    page = (tmp_path / "all.html").read_text()
    assert page.count("finger_small") >= 2
    assert "15.5" in page
    reader = Reader()
    reader.feed(page)
    assert all(float(value) == look_up(summary, key) for key, value in reader.numbers)
    lines = table_lines(summary)
    assert len(lines) == 11
    told = "1 % (10 %) | 1 % (10 %) | {} | 4 % (20 %) | 4 % (20 %) | 0.03 %, 0.2 % |"
    assert lines[2] == f"| finger_small | mechanics | {told.format('')}"
    assert lines[3] == f"| finger_small | ours | {told.format('14 %, 15.5 %')}"
    assert lines[9] == "| finger_small | 7 / 2 | 31218 | 200, -, 100 |"
    keys = {key for key, _ in reader.numbers}
    for model in ("mechanics", "ours"):
        for side in ("learned", "testing"):
            for measure in ("whole_squared", "whole_rms", "squared", "rms"):
                assert f"rows/0/models/{model}/{side}/{measure}" in keys
    assert {"rows/0/noise/noise_floor", "rows/0/noise/noise_90"} <= keys


def test_speeds_are_those_of_bench_with_their_conditions(tmp_path):
    write_report(tmp_path / "finger", "finger_small")
    write_bench(tmp_path / "finger")
    speeds = gather([tmp_path / "finger"], tmp_path / "all.html")["rows"][0]["speeds"]
    assert speeds["full"] is None
    assert speeds["faster_than_full"] is None
    assert speeds["cost_of_bare"] == 2.0
    assert (speeds["ours"]["p95"], speeds["ours"]["converged"]) == (0.03, 0.75)
    page = (tmp_path / "all.html").read_text()
    assert "the scene \u201cpress\u201d" in page
    assert "in parallel with the next step" in page
    assert "not measured" not in page
    write_bench(tmp_path / "finger", cores_used=1)
    gather([tmp_path / "finger"], tmp_path / "all.html")
    assert "one core" in (tmp_path / "all.html").read_text()
    # A file of an earlier version has no number of cores.
    write_bench(tmp_path / "finger", cores_used=None)
    gather([tmp_path / "finger"], tmp_path / "all.html")
    page = (tmp_path / "all.html").read_text()
    assert "one core" not in page
    assert "in parallel with the next step" not in page


def test_without_a_benchmark_no_other_number_is_shown(tmp_path):
    """Motions have recorded steps without a surface: 77 per second."""
    write_report(tmp_path / "cube", "cube")
    summary = gather([tmp_path / "cube"], tmp_path / "all.html")
    assert summary["rows"][0]["speeds"] is None
    page = (tmp_path / "all.html").read_text()
    assert f"softprint bench EXPERIMENT --out {tmp_path / 'cube'}" in page
    assert ">77<" not in page
    assert table_lines(summary)[-1].endswith("| not measured |")
    (tmp_path / "cube" / "bench.json").write_text("{}")
    with pytest.raises(SoftprintError, match=r"bench\.json"):
        gather([tmp_path / "cube"], tmp_path / "all.html")


def test_motions_with_given_states_and_in_free_runs(tmp_path):
    write_report(tmp_path / "cube", "cube")
    summary = gather([tmp_path / "cube"], tmp_path / "all.html")
    press, aside = summary["rows"][0]["motions"]
    assert list(press["models"]) == ["bare", "mechanics", "ours"]
    assert press["models"]["ours"] == {
        "rms": 2.5e-4,
        "left": 0.25,
        "worst": 0.375,
        "alone_rms": 2.5e-3,
        "alone_left": 1.25,
        "not_converged": 3,
    }
    assert press["models"]["mechanics"]["alone_rms"] is None  # it has not simulated the scene
    assert aside["models"] == {}
    reader = Reader()
    reader.feed((tmp_path / "all.html").read_text())
    assert ("rows/0/motions/0/models/ours/alone_left", "1.25") in reader.numbers


def test_the_worst_shapes_come_with_small_pictures_of_the_report(tmp_path):
    write_report(tmp_path / "cube", "cube")
    gather([tmp_path / "cube"], tmp_path / "all.html")
    page = (tmp_path / "all.html").read_text()
    assert "wood screw" in page
    assert "made without pictures" in page
    (tmp_path / "cube" / "report.html").write_text(page_of_shapes(4))
    gather([tmp_path / "cube"], tmp_path / "all.html")
    page = (tmp_path / "all.html").read_text()
    assert "made without pictures" not in page
    assert re.findall(r'<img src="data:image/webp[^"]*" width="(\d+)" height="(\d+)" alt="(\d)"', page) == [
        ("340", "170", kind) for kind in ("0", "1", "3")
    ]


def page_of_shapes(count: int) -> str:
    """Images as in a report, between other pictures: the contact, full space, the bare subspace, ours."""
    pictures = [encode(np.full((300, 600, 4), 200, dtype=np.uint8), str(kind)) for kind in range(count)]
    images = "".join(f'<img src="{picture.uri}" alt="{picture.alt}">' for picture in pictures)
    other = f'<section id="pictures"><article>{images}</article></section>'
    return f'{other}<section id="shapes"><article>{images}</article></section><section id="free">{images}'


def test_studies_are_drawn_where_the_run_has_them(tmp_path):
    run = tmp_path / "cube"
    write_report(run, "cube")
    gather([run], tmp_path / "all.html")
    assert 'id="studies"' not in (tmp_path / "all.html").read_text()
    data = {"testing_error": 0.2, "validation_error": 0.1, "testing_spread": 0.01}
    rows = [{"shapes": shapes, "contacts": contacts, **data} for shapes, contacts in ((4, 1), (4, 2), (2, 2))]
    (run / "bench_how_much_truth.json").write_text(json.dumps({"rows": rows}))
    figures = {"jump": {"thesis6": [0.1, 0.2]}, "void": {"thesis6": [[0.3, 0.8]]}}
    (run / "thesis6_figures.json").write_text(json.dumps(figures))
    gather([run], tmp_path / "all.html")
    page = (tmp_path / "all.html").read_text()
    assert page.count("<svg") == 2
    for words in ("training shapes", "6.3: raw or smoothed normal", "6.6: change by a void"):
        assert words in page
    assert "6.5: one node" not in page  # of another file
    for file in ("thesis6_figures.json", "bench_how_much_truth.json"):
        kept = (run / file).read_text()
        (run / file).write_text('{"rows": [{}]}')
        with pytest.raises(SoftprintError, match=rf"{file}: not what reproduction\.\w+ writes"):
            gather([run], tmp_path / "all.html")
        (run / file).write_text(kept)
    assert (tmp_path / "all.html").read_text() == page


@pytest.mark.parametrize(
    ("changed", "words"),
    [({"shapes": None}, "unseen shapes"), ({"softprint_report": 0}, "not a report of this version")],
)
def test_a_run_that_cannot_be_gathered_is_refused(tmp_path, changed, words):
    write_report(tmp_path / "run", "finger", **changed)
    with pytest.raises(SoftprintError, match=words):
        gather([tmp_path / "run"], tmp_path / "all.html")
    assert not (tmp_path / "all.html").exists()
    with pytest.raises(SoftprintError, match="does not exist"):
        gather([tmp_path / "absent"], tmp_path / "all.html")
