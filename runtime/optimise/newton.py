"""Newton's method with an Armijo line search for small dense problems.

Every iteration steps from x to retract(x, alpha v) with

    H v = -g,    E(retract(x, alpha v)) <= E(x) + c alpha g.v    (Armijo, backtracking from alpha = 1).

Where H is not positive definite (contact with a convex collider, buckling) its eigenvalues are replaced by their
magnitudes, so that v is always a descent direction. The matrix is small, so this is cheap; assembling it is expensive.
If an iteration reduced the residual to the fraction q, another one with the same H is estimated to reduce it to the
fraction 2 q. Where that meets the tolerance, H is used again.

With ``max_iterations`` 1 this is the linearly implicit Euler method of real-time simulation. A result has converged
only if a gradient below the tolerance has been *evaluated*. The reported residual is the last one evaluated: at the
start of the last iteration where the iterations ran out. Where E is discontinuous beside a minimum, the line search
makes no progress in any iteration; this is detected and reported as `Status.STALLED`.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.optimise.descent import Descent
from softprint.runtime.optimise.optimiser import Linearisation, Minimum, Point, Problem
from softprint.runtime.optimise.settings import NewtonSettings
from softprint.runtime.optimise.status import Status

_ARMIJO = 1e-4
# Stalling: the residual is below _NEARLY, but the line search accepts less than the fraction _SHORT of the direction,
# in _STALLS iterations in a row. The energy is then discontinuous close by, and further iterations rarely help. At
# larger residuals many short steps may be necessary.
_NEARLY = 0.05
_SHORT = 0.02
_STALLS = 6
_TRIALS = 20


@dataclass(frozen=True)
class Newton:
    """Newton's method as an `Optimiser`."""

    settings: NewtonSettings = field(default_factory=NewtonSettings)

    @property
    def max_iterations(self) -> int:
        """See `Optimiser`."""
        return self.settings.max_iterations

    def limited(self, iterations: int) -> Newton:
        """See `Optimiser`."""
        return Newton(replace(self.settings, max_iterations=iterations))

    def minimise(
        self,
        problem: Problem[Point],
        x: Point,
        solving: AbstractContextManager[object] | None = None,
        earlier: Minimum[Point] | None = None,
    ) -> Minimum[Point]:
        """See `Optimiser`."""
        clock = nullcontext() if solving is None else solving
        tolerance = self.settings.tolerance
        residual = before = decrement = np.inf
        stalls, descent = 0, None
        if earlier is not None:
            before, decrement, descent = earlier.residual, earlier.decrement, earlier.descent

        def stopped(status: Status, iterations: int) -> Minimum[Point]:
            return Minimum(x, status, iterations, residual, decrement, descent)

        for iteration in range(self.settings.max_iterations):
            at = problem.linearise(x)
            if not at.finite:
                return stopped(Status.NOT_FINITE, iteration)
            residual = at.residual
            if residual <= tolerance:
                return stopped(Status.CONVERGED, iteration)
            if descent is None or 2.0 * residual * (residual / before) > tolerance:
                if not np.isfinite(at.hessian).all():
                    return stopped(Status.NOT_FINITE, iteration)
                with clock:
                    descent = Descent.of(at.hessian)
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
        return stopped(Status.MAX_ITERATIONS, self.settings.max_iterations)


def _line_search(
    problem: Problem[Point], x: Point, at: Linearisation, direction: Array, slope: float
) -> tuple[Point, float] | None:
    """The first point x + alpha v that satisfies Armijo's condition, and alpha as a fraction of the first alpha tried;
    None if there is none.

    alpha starts at 1, or at the largest value that the problem allows. The next alpha is the minimum of the parabola
    through E(x), its slope and the last energy, but at least a tenth and at most half of the last (Nocedal and Wright
    2006, section 3.5).
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
