"""Running cases: what one of them raises is its own failure and nobody else's."""

from __future__ import annotations

import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass

from fem_truth.verify.case import Case, CaseResult
from runtime.errors import SoftprintError


@dataclass(frozen=True)
class Outcome:
    """A case that was run. failure: why it ended early, "" if it did not; seconds: of processor time."""

    case: Case
    result: CaseResult
    failure: str
    seconds: float

    @property
    def passed(self) -> bool:
        return not self.failure and all(row.passed for row in self.result.rows)


def select(cases: Sequence[Case], names: Sequence[str]) -> tuple[Case, ...]:
    """The cases of these names in the suite's order; all of them for no names. Refuses names that there are not."""
    known = [case.name for case in cases]
    for name in names:
        if name not in known:
            raise SoftprintError(f"there is no verification case {name!r}; there are: {', '.join(known)}")
    return tuple(case for case in cases if not names or case.name in names)


def run_case(case: Case, quick: bool) -> Outcome:
    """Its outcome, whatever happens."""
    started = time.process_time()
    try:
        result, failure = case.run(quick), ""
    except SoftprintError as error:
        result, failure = CaseResult(()), str(error)
    except Exception as error:  # a bug in one case must not hide what the others found
        traceback.print_exc()
        result, failure = CaseResult(()), f"{type(error).__name__}: {error}"
    return Outcome(case, result, failure, time.process_time() - started)
