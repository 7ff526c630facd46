"""Newton's method with an Armijo line search for small dense problems: one call for each time step.

Minimises E over a manifold that the problem itself walks on (points and rigid frames; thesis 4.2.3): in every
iteration it is asked for gradient g and Hessian H in tangent coordinates at x, and moves to retract(x, alpha
v) with

    H v = -g,    E(retract(x, alpha v)) <= E(x) + c alpha g.v    (Armijo, backtracking from alpha = 1).

Where H is not positive definite (contact with a convex collider, buckling) its eigenvalues are replaced by
their magnitudes, so that v always leads downhill; the matrix is small, so this costs little. What costs is to find it.
After an iteration that left the share q of the residual, one with the same H leaves about 2 q of the rest (of the
error of H, half has been felt): where that is enough, no new one is asked for.

With ``max_iterations`` 1 this is the linearly implicit Euler method of real-time simulation. The result says
so: it has converged only if a gradient below the tolerance has been *seen*, and the residual it reports is
the last one seen, at the start of the last iteration where the iterations ran out. Where E jumps beside a minimum the
line search goes nowhere, one iteration like the other: that is told, and not tried to the last.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from runtime.arrays import Array, Hessian
from runtime.errors import SoftprintError


class Status(IntEnum):
    """How a minimisation ended. The numbers go into motion files: never renumber."""

    CONVERGED = 0
    MAX_ITERATIONS = 1
    LINE_SEARCH_FAILED = 2
    NOT_FINITE = 4
    STALLED = 5

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]


_SENTENCES = {
    Status.CONVERGED: "The forces balance to the tolerance.",
    Status.MAX_ITERATIONS: "Stopped at the iteration limit before the tolerance was seen to be met: right "
    "for real time; otherwise allow more iterations or take a smaller time step.",
    Status.LINE_SEARCH_FAILED: "No step along the Newton direction lowers the energy: the tolerance may be "
    "below what the correction's float32 network can resolve, or the start has inverted cells.",
    Status.NOT_FINITE: "Energy or gradient is not finite: inverted cells in a material that resists "
    "inversion with infinite energy, or a state that is not made of numbers; take a smaller time step.",
    Status.STALLED: "The energy falls hardly further, but the forces balance only nearly: it jumps close by, as where "
    "a load in contact slips from one side of a thin wall to the other; take a smaller time step.",
}

_ARMIJO = 1e-4
# Where forces balance to this share, and yet an iteration goes less than that share of its direction, the energy jumps
# close by, and the next ones only creep up to where it does: few steps get over it after so many in a row. Far from
# balance many short ones may be what it takes.
_NEARLY = 0.05
_SHORT = 0.02
_STALLS = 6
_TRIALS = 20
# Eigenvalues smaller than this share of the largest are raised to it: nothing moves farther than the model is
# valid.
_SMALLEST_EIGENVALUE = 1e-8


@dataclass(frozen=True)
class NewtonSettings:
    """max_iterations: at most so many linear solves; tolerance: on the residual (see
    `Linearisation.scale`)."""

    max_iterations: int = 20
    tolerance: float = 1e-4

    def __post_init__(self) -> None:
        if self.max_iterations < 1:
            raise SoftprintError(f"max_iterations must be at least 1, not {self.max_iterations}")
        if not self.tolerance > 0:
            raise SoftprintError(f"the Newton tolerance must be positive, not {self.tolerance}")


@dataclass(frozen=True, eq=False)
class Linearisation:
    """E at a point, to second order in tangent coordinates (n,).

    energy [J]; noise [J]: differences of energy below it mean nothing; gradient (n,); second_derivative: gives the
    Hessian, which only an iteration that goes on asks for; scale: the residual is |gradient| / scale.
    """

    energy: float
    noise: float
    gradient: Array
    second_derivative: Hessian
    scale: float

    @cached_property
    def hessian(self) -> Array:
        """(n, n)."""
        return self.second_derivative()


Point = TypeVar("Point")


class Problem(Protocol[Point]):
    """What is minimised. x is whatever the problem says it is."""

    def linearise(self, x: Point) -> Linearisation: ...

    def energy(self, x: Point) -> float:
        """The same energy as that of the last `linearise`, for the line search."""
        ...

    def retract(self, x: Point, v: Array) -> Point: ...

    def longest(self, x: Point, v: Array) -> float:
        """The share of v, 1 at most, that a step from x may go at once."""
        ...


class Descent:
    """Directions v with H v = -g for gradients g, of one Hessian H (n, n), factorised; with |H| (the same eigenvectors,
    absolute eigenvalues) where H is not positive definite."""

    def __init__(self, hessian: Array) -> None:
        try:
            self._factor, self._spectrum = cho_factor(hessian, lower=True, check_finite=False), None
        except LinAlgError:
            values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
            magnitude: Array = np.abs(values)
            floor = max(_SMALLEST_EIGENVALUE * float(magnitude.max()), float(np.finfo(float).tiny))
            self._factor, self._spectrum = None, (np.maximum(magnitude, floor), vectors)

    def __call__(self, gradient: Array) -> Array:
        """v (n,)."""
        if self._spectrum is None:
            solution: Array = cho_solve(self._factor, gradient, check_finite=False)
            return -solution
        magnitude, vectors = self._spectrum
        return -(vectors @ ((vectors.T @ gradient) / magnitude))


@dataclass(frozen=True, eq=False)
class NewtonResult(Generic[Point]):
    """x: where the minimisation stopped; residual: |g| / scale when last seen; decrement: 1/2 g^T H^-1 g [J]
    of the last step taken, an estimate of how far above the minimum the energy was before it; descent: of its Hessian,
    None where no step was taken."""

    x: Point
    status: Status
    iterations: int
    residual: float
    decrement: float
    descent: Descent | None = None

    @property
    def converged(self) -> bool:
        return self.status is Status.CONVERGED

    @property
    def reason(self) -> str:
        return f"{self.status.sentence} (iterations {self.iterations}, residual {self.residual:.1e})"


def minimise(
    problem: Problem[Point],
    x: Point,
    settings: NewtonSettings,
    solving: AbstractContextManager[object] | None = None,
) -> NewtonResult[Point]:
    """Minimise the problem's energy from x. ``solving`` is entered around every linear solve, to time it."""
    clock = nullcontext() if solving is None else solving
    residual = before = decrement = np.inf
    stalls, descent = 0, None

    def stopped(status: Status, iterations: int) -> NewtonResult[Point]:
        return NewtonResult(x, status, iterations, residual, decrement, descent)

    for iteration in range(settings.max_iterations):
        at = problem.linearise(x)
        if not (np.isfinite(at.energy) and np.isfinite(at.gradient).all()):
            return stopped(Status.NOT_FINITE, iteration)
        residual = float(np.linalg.norm(at.gradient)) / at.scale
        if residual <= settings.tolerance:
            return stopped(Status.CONVERGED, iteration)
        if descent is None or 2.0 * residual * (residual / before) > settings.tolerance:
            if not np.isfinite(at.hessian).all():
                return stopped(Status.NOT_FINITE, iteration)
            with clock:
                descent = Descent(at.hessian)
        before = residual
        with clock:
            direction = descent(at.gradient)
        slope = float(at.gradient @ direction)
        decrement = -0.5 * slope
        stepped = _line_search(problem, x, at, direction, slope)
        if stepped is None:
            return stopped(Status.LINE_SEARCH_FAILED, iteration + 1)
        x, share = stepped
        stalls = stalls + 1 if residual < _NEARLY and share < _SHORT else 0
        if stalls == _STALLS:
            return stopped(Status.STALLED, iteration + 1)
    return stopped(Status.MAX_ITERATIONS, settings.max_iterations)


def _line_search(
    problem: Problem[Point], x: Point, at: Linearisation, direction: Array, slope: float
) -> tuple[Point, float] | None:
    """The first point x + alpha v that satisfies Armijo's condition, and alpha as a share of the first one that was
    tried; None if none does.

    alpha starts at 1, or at what the problem allows; each next one is where the parabola through E(x), its slope and
    the last energy is lowest, but at least a tenth and at most half of the last (Nocedal and Wright 2006, section 3.5).
    """
    first = step = problem.longest(x, direction)
    for _ in range(_TRIALS):
        candidate = problem.retract(x, step * direction)
        energy = problem.energy(candidate)
        if energy <= at.energy + _ARMIJO * step * slope + at.noise:
            return candidate, step / first
        lowest = (
            -0.5 * slope * step**2 / (energy - at.energy - slope * step)
            if np.isfinite(energy)
            else 0.5 * step
        )
        step = float(np.clip(lowest, 0.1 * step, 0.5 * step))
    return None
