"""The cases of the suite, in the order in which they run and are told."""

from __future__ import annotations

from fem_truth.verify.case import Case
from fem_truth.verify.cases import (
    closed_forms,
    constrained,
    cook,
    hertz,
    independent_library,
    manufactured_solutions,
)

CASES: tuple[Case, ...] = (
    closed_forms.CASE,
    manufactured_solutions.CASE,
    cook.CASE,
    hertz.CASE,
    independent_library.CASE,
    constrained.CASE,
)
