"""What a case of `softprint verify` is: a stated problem, numbers from elsewhere, and ours beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from runtime.arrays import Array

#: How our number has to stand to the reference: equal to it, at most it, at least it; each but for the tolerance.
Relation = Literal["=", "<=", ">="]


@dataclass(frozen=True)
class Row:
    """One compared number.

    quantity: what it is ("lateral stretch at stretch 2"); unit: "" if none; reference: what it should be; source:
    where the reference comes from, in words that a reader can follow (paper, equation, published set), never this
    code; tolerance: allowed |ours - reference|, absolute, in the unit; tolerance_reason: why so much; order: the
    observed order of convergence where there is one; relation: "<=" and ">=" for bounds.
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
        """What errors are measured against: the reference, or 1 (absolute errors) where that is zero."""
        return abs(self.reference) or 1.0

    @property
    def excess(self) -> float:
        """How far ours is from what is asked, in the unit: zero on the right side of a bound."""
        difference = self.ours - self.reference
        if self.relation == "=":
            return abs(difference)
        # `max` would turn a number that is none into zero
        beyond = difference if self.relation == "<=" else -difference
        return 0.0 if beyond <= 0.0 else beyond

    @property
    def error(self) -> float:
        """Relative; absolute, in the unit, where the reference is zero."""
        return self.excess / self.scale

    @property
    def allowed(self) -> float:
        """The largest `error` that passes."""
        return self.tolerance / self.scale

    @property
    def share(self) -> float:
        """The error as a share of what is allowed: at most 1 if the row has passed."""
        if self.excess == 0.0:
            return 0.0
        return self.excess / self.tolerance if self.tolerance > 0 else float("inf")

    @property
    def passed(self) -> bool:
        """False for an answer that is no number."""
        return self.excess <= self.tolerance


@dataclass(frozen=True)
class Line:
    """One line of a plot. style: "measured" (dots joined by a line), "curve" (a line), "dots", or "reference" (thin and
    dashed: what theory or others say)."""

    label: str
    x: Sequence[float] | Array
    y: Sequence[float] | Array
    style: Literal["measured", "curve", "dots", "reference"] = "measured"


@dataclass(frozen=True)
class Curve:
    """Something worth plotting; log: both axes logarithmic."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    log: bool = False


@dataclass(frozen=True)
class CaseResult:
    """What a case found. notes: what a reader should know besides, in plain sentences."""

    rows: tuple[Row, ...]
    curves: tuple[Curve, ...] = ()
    notes: str = ""


@dataclass(frozen=True)
class Case:
    """A problem with a known answer.

    name: what the command line selects it by; statement: the problem, its equations and what is shown, a paragraph of
    plain text; run(quick): quick is coarse and takes a few seconds, for the tests. What hinders a case from running at
    all is a SoftprintError.
    """

    name: str
    title: str
    statement: str
    sources: tuple[str, ...]
    run: Callable[[bool], CaseResult]
