"""Problems and optimisers: small dense minimisation, one call for each time step.

A problem is an energy E over a manifold (points and rigid frames; thesis 4.2.3). It computes the gradient g (n,) and
the Hessian H (n, n) in tangent coordinates at x, and retract(x, v), the point that the tangent vector v (n,) leads to.
An optimiser is a frozen object of settings. To use another one, pass it to `DynamicsSettings(optimiser=...)`.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from softprint.runtime.arrays import Array, Hessian
from softprint.runtime.lazy import lazy
from softprint.runtime.optimise.descent import Descent
from softprint.runtime.optimise.status import Status

Point = TypeVar("Point")


@dataclass(frozen=True, eq=False)
class Linearisation:
    """E at a point, to second order in tangent coordinates (n,).

    energy [J]; noise [J]: smaller differences of the energy are round-off; gradient (n,); second_derivative: computes
    the Hessian, called only where an iteration needs it; scale: of all or of each (n,): the residual is
    |gradient / scale|.
    """

    energy: float
    noise: float
    gradient: Array
    second_derivative: Hessian
    scale: float | Array

    @lazy
    def hessian(self) -> Array:
        """(n, n)."""
        return self.second_derivative()

    @property
    def finite(self) -> bool:
        """Whether energy and gradient are finite."""
        return bool(np.isfinite(self.energy) and np.isfinite(self.gradient).all())

    @property
    def residual(self) -> float:
        return float(np.linalg.norm(self.gradient / self.scale))


class Problem(Protocol[Point]):
    """An energy to minimise. The type of its points x is its own choice."""

    def linearise(self, x: Point) -> Linearisation: ...

    def energy(self, x: Point) -> float:
        """The same energy as that of the last `linearise`, for the line search."""
        ...

    def retract(self, x: Point, v: Array) -> Point: ...

    def longest(self, x: Point, v: Array) -> float:
        """The largest fraction of v, at most 1, that one step from x may take."""
        ...


@dataclass(frozen=True, eq=False)
class Minimum(Generic[Point]):
    """The result of a minimisation.

    x: the last point; iterations: linear solves, or what the optimiser counts instead; residual: |g| / scale as last
    evaluated; decrement: 1/2 g^T H^-1 g [J] of the last step taken, an estimate of how far the energy before it was
    above the minimum (NaN if the optimiser does not compute it); descent: the last factorised Hessian, None without
    one.
    """

    x: Point
    status: Status
    iterations: int
    residual: float
    decrement: float = np.nan
    descent: Descent | None = None

    @property
    def converged(self) -> bool:
        return self.status is Status.CONVERGED

    @property
    def reason(self) -> str:
        return f"{self.status.sentence} (iterations {self.iterations}, residual {self.residual:.1e})"


class Optimiser(Protocol):
    """A method of minimisation, with its settings."""

    @property
    def max_iterations(self) -> int:
        """At most so many iterations."""
        ...

    def limited(self, iterations: int) -> Optimiser:
        """The same method with at most so many iterations."""
        ...

    def minimise(
        self,
        problem: Problem[Point],
        x: Point,
        solving: AbstractContextManager[object] | None = None,
        earlier: Minimum[Point] | None = None,
    ) -> Minimum[Point]:
        """Minimise the problem's energy from x. solving: entered around every linear solve, to time it; earlier: the
        minimisation of nearly the same energy that led to x, whose factorised Hessian may be used again."""
        ...
