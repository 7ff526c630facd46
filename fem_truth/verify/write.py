"""verify.html, which stands alone, and verify.json: all that a run of the suite found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from fem_truth.report.machine import machine_summary
from fem_truth.report.page import page_style, page_template
from fem_truth.report.report_json import json_text, plain, write_text
from fem_truth.verify.case import Row
from fem_truth.verify.plots import colour_variables, draw
from fem_truth.verify.suite import Outcome
from fem_truth.verify.table import as_json, format_error, shown
from fem_truth.verify.typeset import typeset
from runtime.io.files import provenance

VERSION = 1  # of verify.json


def write_page(outcomes: Sequence[Outcome], folder: Path, quick: bool) -> Path:
    """Both files, each whole or not at all; returns the page's path. Raises SoftprintError where it cannot write."""
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
    """The page as HTML text that loads nothing."""
    template = page_template("fem_truth.verify", "verify.html.j2")
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
    """What the rows say of sources and tolerances, each sentence once, and the number of each row's."""
    told = [f"{row.source}. Tolerance: {row.tolerance_reason}." for row in rows]
    distinct = list(dict.fromkeys(told))
    return distinct, [distinct.index(text) + 1 for text in told]


def _finite_elements() -> dict[str, str]:
    from fem_truth.dolfinx_version import versions

    return versions()
