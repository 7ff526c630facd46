"""The cases of the suite, in the order in which they run and are reported."""

from __future__ import annotations

from softprint.fem_truth.verify.case import Case
from softprint.fem_truth.verify.cases import (
    backward_euler,
    closed_forms,
    condensed_contact,
    constrained,
    cook,
    energy,
    flat_contact,
    free_body,
    frequency,
    hertz,
    impact,
    incline,
    independent_library,
    manufactured_solutions,
    resting,
)

STATIC: tuple[Case, ...] = (
    closed_forms.CASE,
    manufactured_solutions.CASE,
    cook.CASE,
    hertz.CASE,
    flat_contact.CASE,
    independent_library.CASE,
    constrained.CASE,
    condensed_contact.CASE,
)

DYNAMIC: tuple[Case, ...] = (
    backward_euler.CASE,
    free_body.CASE,
    energy.CASE,
    frequency.CASE,
    impact.CASE,
    resting.CASE,
    incline.CASE,
)

CASES = STATIC + DYNAMIC
