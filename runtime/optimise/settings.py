"""The settings of Newton's method, in reduced and in full space."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from numbers import Integral, Real

from softprint.runtime.errors import SoftprintError


@dataclass(frozen=True)
class NewtonSettings:
    """max_iterations: the largest number of linear solves; tolerance: on the relative residual |gradient| / scale, with
    the scale of the problem. Raises SoftprintError unless both are positive."""

    max_iterations: int = 20
    tolerance: float = 1e-4

    def __post_init__(self) -> None:
        if not isinstance(self.max_iterations, Integral) or self.max_iterations < 1:
            raise SoftprintError(
                f"max_iterations must be a whole number, at least 1, not {self.max_iterations!r}"
            )
        if not isinstance(self.tolerance, Real) or not 0 < self.tolerance < inf:
            raise SoftprintError(f"the Newton tolerance must be a positive number, not {self.tolerance!r}")
