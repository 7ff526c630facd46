"""Writes verify.html, which is self-contained, and verify.json: all results of a run of the suite."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from softprint.fem_truth.report.machine import machine_summary
from softprint.fem_truth.report.page import page_style, page_template
from softprint.fem_truth.report.report_json import json_text, plain, write_text
from softprint.fem_truth.verify.case import Row
from softprint.fem_truth.verify.plots import colour_variables, draw
from softprint.fem_truth.verify.suite import Outcome
from softprint.fem_truth.verify.table import as_json, format_error, shown
from softprint.fem_truth.verify.typeset import typeset
from softprint.runtime.io.files import provenance

VERSION = 1  # of verify.json


def write_page(outcomes: Sequence[Outcome], folder: Path, quick: bool) -> Path:
    """Write both files atomically; returns the page's path. Raises SoftprintError if they cannot be written."""
    versions = {**provenance(), **_finite_elements()}
    summary = {
        "softprint_verification": VERSION,
        "quick": quick,
        "passed": all(outcome.passed for outcome in outcomes),
        "versions": versions,
        "machine": machine_summary(),
        "cases": as_json(outcomes),
    }
    page = folder / "verify.html"
    write_text(folder / "verify.json", json_text(plain(summary)))
    write_text(page, render(outcomes, quick, versions))
    return page


def render(outcomes: Sequence[Outcome], quick: bool, versions: dict[str, str]) -> str:
    """The page as self-contained HTML text."""
    template = page_template("softprint.fem_truth.verify", "verify.html.j2")
    rows = [row for outcome in outcomes for row in outcome.result.rows]
    return template.render(
        outcomes=outcomes,
        plots={
            outcome.case.name: Markup(draw(outcome.case.name, outcome.result.curves))
            for outcome in outcomes
            if outcome.result.curves
        },
        n_rows=len(rows),
        n_rows_passed=sum(row.passed for row in rows),
        n_passed=sum(outcome.passed for outcome in outcomes),
        shown=shown,
        error=format_error,
        typeset=typeset,
        footnotes={outcome.case.name: _footnotes(outcome.result.rows) for outcome in outcomes},
        bounds={"=": "", "<=": "\u2264\u202f", ">=": "\u2265\u202f"},
        quick=quick,
        seconds=sum(outcome.seconds for outcome in outcomes),
        versions=versions,
        machine=machine_summary(),
        css=Markup(page_style()),
        colours=Markup(colour_variables()),
    )


def _footnotes(rows: Sequence[Row]) -> tuple[list[str], list[int]]:
    """Footnotes on sources and tolerances, each distinct one once, and the footnote number of each row."""
    sentences = [f"{row.source}. Tolerance: {row.tolerance_reason}." for row in rows]
    distinct = list(dict.fromkeys(sentences))
    return distinct, [distinct.index(text) + 1 for text in sentences]


def _finite_elements() -> dict[str, str]:
    from softprint.fem_truth.elasticity.dolfinx_version import versions

    return versions()
