"""A case of `softprint verify`: a problem statement, independent reference values, and ours compared with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from softprint.runtime.arrays import Array

#: Required relation of our number to the reference: equal, at most or at least, each within the tolerance.
Relation = Literal["=", "<=", ">="]


@dataclass(frozen=True)
class Row:
    """One compared number.

    quantity: its name ("lateral stretch at stretch 2"); unit: "" if none; reference: the expected value; source: of the
    reference, so that a reader can find it (paper, equation, published data set), never this code; tolerance: allowed
    |ours - reference|, absolute, in the unit; tolerance_reason: justification of the tolerance; order: the observed
    order of convergence if there is one; relation: "<=" and ">=" for bounds.
    """

    quantity: str
    unit: str
    reference: float
    source: str
    ours: float
    tolerance: float
    tolerance_reason: str
    order: float | None = None
    relation: Relation = "="

    @property
    def scale(self) -> float:
        """The scale of relative errors: the reference, or 1 (absolute errors) if it is zero."""
        return abs(self.reference) or 1.0

    @property
    def excess(self) -> float:
        """Deviation of ours from the reference, in the unit: zero if a bound is satisfied."""
        difference = self.ours - self.reference
        if self.relation == "=":
            return abs(difference)
        # `max` would turn NaN into zero
        beyond = difference if self.relation == "<=" else -difference
        return 0.0 if beyond <= 0.0 else beyond

    @property
    def error(self) -> float:
        """The relative error; absolute, in the unit, if the reference is zero."""
        return self.excess / self.scale

    @property
    def allowed(self) -> float:
        """The largest `error` that passes."""
        return self.tolerance / self.scale

    @property
    def share(self) -> float:
        """The error relative to the allowed error: at most 1 if the row has passed."""
        if self.excess == 0.0:
            return 0.0
        return self.excess / self.tolerance if self.tolerance > 0 else float("inf")

    @property
    def passed(self) -> bool:
        """Whether the error is allowed; False if ours is NaN."""
        return self.excess <= self.tolerance


@dataclass(frozen=True)
class Line:
    """One line of a plot. style: "measured" (dots joined by a line), "curve" (a line), "dots", or "reference" (thin and
    dashed: theory or results of others)."""

    label: str
    x: Sequence[float] | Array
    y: Sequence[float] | Array
    style: Literal["measured", "curve", "dots", "reference"] = "measured"


@dataclass(frozen=True)
class Curve:
    """One plot; log: both axes logarithmic."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    log: bool = False


@dataclass(frozen=True)
class CaseResult:
    """Results of a case. notes: additional remarks, in plain sentences."""

    rows: tuple[Row, ...]
    curves: tuple[Curve, ...] = ()
    notes: str = ""


@dataclass(frozen=True)
class Case:
    """A problem with a known solution.

    name: for selection on the command line; statement: the problem, its equations and what is shown, in plain text;
    run(quick): quick is coarse and takes a few seconds, for the tests. Raises SoftprintError if the case cannot run at
    all.
    """

    name: str
    title: str
    statement: str
    sources: tuple[str, ...]
    run: Callable[[bool], CaseResult]
