"""Many reports on one page: table 6.1 of the thesis, motions and the worst shapes of every body from the report of
each run; speeds from its bench.json; the studies of chapter 6 and of the amount of training data from the files that
benchmarks wrote.

For the four bodies of the thesis, its own results are shown beside ours.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from markupsafe import Markup

from softprint.fem_truth.report.drawing.data_plot import data_figure_of
from softprint.fem_truth.report.drawing.figures import RC, to_svg
from softprint.fem_truth.report.drawing.picture import Picture
from softprint.fem_truth.report.drawing.thesis6_plots import thesis6_figure
from softprint.fem_truth.report.drawing.worst_pictures import worst_pictures
from softprint.fem_truth.report.measurements.learning import read_json, read_table
from softprint.fem_truth.report.page import Numbers, look_up, page_style, page_template
from softprint.fem_truth.report.report_json import REPORT_VERSION, json_text, plain, write_text
from softprint.runtime.errors import SoftprintError


@dataclass(frozen=True)
class ThesisRow:
    """A row of table 6.1: samples are shapes x states x contacts; squared errors as fractions; frames per second."""

    samples: str
    train: float
    test: float
    linear: float
    full: float
    ours: float


THESIS = {
    "ball": ThesisRow("30 x 1 x 150", 0.208, 0.210, 129, 1, 9),
    "hand": ThesisRow("30 x 1 x 525", 0.171, 0.168, 81, 1, 26),
    "jelly": ThesisRow("30 x 5 x 105", 0.162, 0.179, 200, 1, 24),
    "finger": ThesisRow("30 x 1 x 32", 0.140, 0.155, 142, 1, 11),
}

# Of a model's line in bench.json; times of a frame [s].
_MEASURED = ("steps", "frames_per_second", "mean", "p95", "median", "converged")


def gather(runs: Sequence[Path], page: Path) -> dict[str, Any]:
    """Write the page and, beside it, the same numbers as JSON. Returns the numbers.

    Raises SoftprintError if a run has no report, or one without unseen shapes.
    """
    summary: dict[str, Any] = plain(
        {"softprint_gathered": 1, "rows": [_row(run, page.parent) for run in runs]}
    )
    html = _render(summary, [_drawn(run, str(number)) for number, run in enumerate(runs)])
    write_text(page.with_suffix(".json"), json_text(summary))
    write_text(page, html)
    return summary


def _row(run: Path, seen_from: Path) -> dict[str, Any]:
    path = run / "report.json"
    if not path.is_file():
        raise SoftprintError(f"{path} does not exist: run `softprint report` for it first")
    report = read_json(path)
    if not isinstance(report, dict) or report.get("softprint_report") != REPORT_VERSION:
        raise SoftprintError(f"{path}: not a report of this version: run `softprint report` again")
    if not report.get("shapes"):
        raise SoftprintError(
            f"{path}: has no results on unseen shapes; they need an experiment with a [library] and a trained model"
        )
    judged = report["shapes"]["judged"]
    sides = {model: _sides(rows) for model, rows in report["shapes"]["sides"].items()}
    name = report["experiment"]["name"]
    thesis = next((row for body, row in THESIS.items() if name.startswith(body)), None)
    return {
        "name": name,
        "report": os.path.relpath(path.with_suffix(".html"), seen_from),
        "judged": judged,
        "body": {key: report["body"][key] for key in ("points", "frames", "cells", "nodes")},
        "models": sides,
        "contacts": report["shapes"]["contacts"],
        "states": report["truth"]["states"],
        "noise": {key: report["truth"].get(key) for key in ("noise_floor", "noise_90")},
        "worst": [_worst(report["shapes"], shape["shape"]) for shape in report["shapes"]["worst"]],
        "motions": [_motion(scene) for scene in report["scenes"]],
        "run": str(run),
        "speeds": _speeds(run, judged),
        "thesis": None if thesis is None else vars(thesis),
    }


def _sides(rows: Mapping[str, Any]) -> dict[str, Any]:
    """`learned` and `testing` of one model, as far as they exist."""
    keys = ("squared", "rms", "whole_squared", "whole_rms", "worst", "samples")
    return {side: {key: row[key] for key in keys} for side, row in rows.items()}


def _worst(shapes: Mapping[str, Any], shape: str) -> dict[str, Any]:
    """One of the judged model's worst testing shapes."""
    row = shapes["shapes"][shapes["judged"]][shape]
    return {"shape": shape, **{key: row[key] for key in ("whole_squared", "whole_rms", "squared", "rms")}}


def _motion(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Errors of every model in a test scene: at the states of full space, and in a free run. RMS in metres; `left` and
    `worst` relative to the bare subspace."""
    given, alone = scene["errors_all"], scene["free"]
    return {
        "name": scene["name"],
        "contact": scene["n_contact"],
        "models": {
            model: {
                "rms": look_up(given, f"{model}/rms"),
                "left": look_up(given, f"{model}/relative_rms"),
                "worst": look_up(given, f"{model}/relative_worst"),
                "alone_rms": look_up(alone, f"{model}/rms"),
                "alone_left": look_up(alone, f"{model}/relative"),
                "not_converged": look_up(alone, f"{model}/not_converged"),
            }
            for model in dict.fromkeys([*given, *alone])
            if model != "full"
        },
    }


def _speeds(run: Path, judged: str) -> dict[str, Any] | None:
    """Speeds of the bare subspace, full space and the judged model measured by `softprint bench`, with its conditions;
    None if it was not run. Timings recorded in motions are not comparable, because they do not include the surface."""
    path = run / "bench.json"
    if not path.is_file():
        return None
    table = read_table(path)
    by_model = {row.get("model"): row for row in table["rows"]}
    rows = {
        name: by_model.get(model) for name, model in (("bare", "bare"), ("full", "full"), ("ours", judged))
    }
    means = {name: look_up(row or {}, "mean") for name, row in rows.items()}
    return {
        **{name: row and {key: row.get(key) for key in _MEASURED} for name, row in rows.items()},
        "cost_of_bare": means["ours"] / means["bare"] if means["ours"] and means["bare"] else None,
        "faster_than_full": means["full"] / means["ours"] if means["full"] and means["ours"] else None,
        "conditions": table.get("conditions"),
    }


@dataclass(frozen=True)
class _Drawn:
    """Pictures and plots of a body: `worst_pictures`, and plots as SVG text."""

    worst: list[list[Picture]]
    thesis6: str | None
    data: str | None


def _drawn(run: Path, name: str) -> _Drawn:
    with plt.rc_context(RC):
        plots = {
            kind: None if figure is None else Markup(to_svg(figure, f"{kind}{name}", {}))
            for kind, figure in (("thesis6", thesis6_figure(run)), ("data", data_figure_of(run)))
        }
    return _Drawn(worst_pictures(run / "report.html"), **plots)


def _render(summary: Mapping[str, Any], drawn: Sequence[_Drawn]) -> str:
    template = page_template("softprint.fem_truth.report", "gather.html.j2")
    return template.render(s=summary, n=Numbers(summary), drawn=drawn, css=Markup(page_style()))


def table_lines(summary: Mapping[str, Any]) -> list[str]:
    """Two Markdown tables for the console: errors of every model, squared and (root), of the whole full-space
    displacement, as in the thesis, and of contact alone; sizes and speeds of the bodies."""
    lines = [
        "| body | model | training shapes | unseen | thesis | contact alone: training shapes | unseen "
        "| noise, median and 90 % |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in summary["rows"]:
        for model, sides in row["models"].items():
            errors = [
                f"{_percent(look_up(sides, f'{side}/{measure}squared'))} "
                f"({_percent(look_up(sides, f'{side}/{measure}rms'))})"
                for measure in ("whole_", "")
                for side in ("learned", "testing")
            ]
            thesis = row["thesis"] if model == row["judged"] else None
            reference = f"{_percent(thesis['train'])}, {_percent(thesis['test'])}" if thesis else ""
            noise = ", ".join(_percent(value) for value in row["noise"].values())
            cells = (row["name"], model, *errors[:2], reference, *errors[2:], noise)
            lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "| body | handles | tets | bare, full, ours [1/s] |", "| --- | --- | --- | --- |"]
    for row in summary["rows"]:
        rates = (look_up(row, f"speeds/{name}/frames_per_second") for name in ("bare", "full", "ours"))
        speeds = ", ".join(_plain(rate) for rate in rates) if row["speeds"] else "not measured"
        body = row["body"]
        lines.append(f"| {row['name']} | {body['points']} / {body['frames']} | {body['cells']} | {speeds} |")
    return lines


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.3g} %"


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
