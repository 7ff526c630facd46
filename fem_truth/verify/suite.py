"""Runs cases: an exception in one case is recorded as its failure and does not affect the others."""

from __future__ import annotations

import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass

from softprint.fem_truth.verify.case import Case, CaseResult
from softprint.runtime.errors import SoftprintError


@dataclass(frozen=True)
class Outcome:
    """The outcome of a case. failure: why it ended early, "" if it did not; seconds: processor time."""

    case: Case
    result: CaseResult
    failure: str
    seconds: float

    @property
    def passed(self) -> bool:
        return not self.failure and all(row.passed for row in self.result.rows)


def select(cases: Sequence[Case], names: Sequence[str]) -> tuple[Case, ...]:
    """The cases with these names in the suite's order; all of them without names. Raises SoftprintError for unknown
    names."""
    known = [case.name for case in cases]
    for name in names:
        if name not in known:
            raise SoftprintError(f"there is no verification case {name!r}; there are: {', '.join(known)}")
    return tuple(case for case in cases if not names or case.name in names)


def run_case(case: Case, quick: bool) -> Outcome:
    """Run a case and return its outcome; never raises."""
    started = time.process_time()
    try:
        result, failure = case.run(quick), ""
    except SoftprintError as error:
        result, failure = CaseResult(()), str(error)
    except Exception as error:  # a bug in one case must not hide the results of the others
        traceback.print_exc()
        result, failure = CaseResult(()), f"{type(error).__name__}: {error}"
    return Outcome(case, result, failure, time.process_time() - started)
