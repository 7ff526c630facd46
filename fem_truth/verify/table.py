"""The outcome of a suite for a terminal and as plain numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from softprint.fem_truth.verify.case import Row
from softprint.fem_truth.verify.suite import Outcome

_WIDTHS = (50, 20, 13, 8, 8, 6)  # quantity, reference, ours, error, allowed, order


def header() -> str:
    """The line above the first case."""
    return _line(("quantity", "reference", "ours", "error", "allowed", "order"), "")


def lines(outcome: Outcome) -> list[str]:
    """A case as lines of text: one line per number, the reason of a failure, and the verdict."""
    text = []
    for row in outcome.result.rows:
        reference, ours = shown(row)
        bound = {"=": "", "<=": "at most ", ">=": "at least "}[row.relation]
        order = "" if row.order is None else f"{row.order:.2f}"
        cells = (
            f"  {_named(row)}",
            bound + reference,
            ours,
            format_error(row.error),
            format_error(row.allowed),
            order,
        )
        text.append(_line(cells, "ok" if row.passed else "FAILED"))
    if outcome.failure:
        text.append(f"  did not finish: {outcome.failure}")
    text.append(f"  {'passed' if outcome.passed else 'FAILED'} in {outcome.seconds:.1f} s of processor time")
    return text


def summary(outcomes: Sequence[Outcome]) -> str:
    """The last line: numbers of passed cases and rows."""
    rows = [row for outcome in outcomes for row in outcome.result.rows]
    cases = sum(outcome.passed for outcome in outcomes)
    return (
        f"{cases} of {len(outcomes)} cases passed, {sum(row.passed for row in rows)} of {len(rows)} numbers, "
        f"in {sum(outcome.seconds for outcome in outcomes):.0f} s of processor time"
    )


def shown(row: Row) -> tuple[str, str]:
    """Reference and ours with as many digits as the tolerance resolves, and one more."""
    size = max(abs(row.reference), abs(row.ours)) if math.isfinite(row.ours) else abs(row.reference)
    digits = 4
    if row.tolerance > 0 and size > 0:
        digits = max(4, min(10, math.ceil(math.log10(size / row.tolerance)) + 1))
    return _number(row.reference, digits), _number(row.ours, digits)


def format_error(error: float) -> str:
    """A percentage down to a hundredth of a percent, scientific notation below it."""
    if error == 0.0 or not math.isfinite(error):
        return f"{error:g}"
    return f"{100 * error:.2g} %" if 1e-4 <= error < 10 else f"{error:.0e}"


def as_json(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Every outcome in JSON types, except for numbers that are not finite."""
    return [
        {
            "name": outcome.case.name,
            "title": outcome.case.title,
            "statement": outcome.case.statement,
            "sources": outcome.case.sources,
            "passed": outcome.passed,
            "failure": outcome.failure,
            "seconds": outcome.seconds,
            "notes": outcome.result.notes,
            "rows": [
                {
                    "quantity": row.quantity,
                    "unit": row.unit,
                    "reference": row.reference,
                    "relation": row.relation,
                    "source": row.source,
                    "ours": row.ours,
                    "error": row.error,
                    "tolerance": row.tolerance,
                    "tolerance_reason": row.tolerance_reason,
                    "order": row.order,
                    "passed": row.passed,
                }
                for row in outcome.result.rows
            ],
        }
        for outcome in outcomes
    ]


def _number(value: float, digits: int) -> str:
    """The number with significant digits, without an exponent for round numbers."""
    if value == 0.0:
        return "0"
    text = f"{value:#.{digits}g}".rstrip(".")  # with trailing zeros, so that the columns agree
    return f"{value:.0f}" if "e" in text and 1.0 <= abs(value) < 1e7 else text


def _named(row: Row) -> str:
    return f"{row.quantity} [{row.unit}]" if row.unit else row.quantity


def _line(cells: Sequence[str], verdict: str) -> str:
    first, *others = cells
    # A long name gets a separate line, so that the columns stay aligned.
    lead = f"{first:<{_WIDTHS[0]}}" if len(first) <= _WIDTHS[0] else f"{first}\n{'':<{_WIDTHS[0]}}"
    columns = "".join(f" {cell:>{width}}" for cell, width in zip(others, _WIDTHS[1:]))
    return f"{lead}{columns}  {verdict}".rstrip()
