"""Newton's method with truncated projected CG and a line search: used by every full-space solve, static or dynamic.

Minimises E(x) over x0 + (null space). A solve counts as converged only if BOTH measures are below tolerance:

    residual   = |P E'(x)| / force scale                        (how well forces balance)
    decrement  = 1/2 d^T H d / energy scale ~ 1/2 (|error| / |displacement|)^2 in the energy norm

with d the Newton step. The residual alone does not bound the error of the displacement:
soft, smooth modes have large displacements and small forces. A decrement of 1e-4 means an error of about 1 %.
The decrement is that of the last full step taken, so the returned solution is one Newton step better than it says.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.optimise import NewtonSettings, Status


@dataclass(frozen=True)
class FullSpaceSettings:
    """newton: its tolerance is that of the residual; decrement_tolerance: see the module.

    cg_tolerance: loosest relative tolerance of the linear solver; it tightens with the square of the decrease of
    the nonlinear residual (Eisenstat and Walker 1996, choice 2), not below cg_tolerance_min.
    cg_max_iterations: of CG in one Newton iteration. line_search_halvings: largest number of halvings of a step.
    """

    newton: NewtonSettings = field(default_factory=lambda: NewtonSettings(max_iterations=60, tolerance=3e-4))
    decrement_tolerance: float = 1e-4
    cg_tolerance: float = 0.1
    cg_tolerance_min: float = 1e-3
    cg_max_iterations: int = 2000
    line_search_halvings: int = 25


class GradientOf(Protocol):
    """E' with all terms (n, dim), by the nodes, and the norm of its projection."""

    @property
    def whole(self) -> Array: ...
    @property
    def norm(self) -> float: ...


Point = TypeVar("Point")
Slope = TypeVar("Slope", bound=GradientOf)
Step = TypeVar("Step")
_Step = TypeVar("_Step", covariant=True)


class DirectionOf(Protocol[_Step]):
    """The solution of a linear system, as in `CgResult`."""

    @property
    def step(self) -> _Step: ...
    @property
    def slope(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def negative_curvature(self) -> bool: ...
    @property
    def direction(self) -> Array | None: ...


class Problem(Protocol[Point, Slope, Step]):
    """What is minimised: `TotalEnergy` over the positions of the nodes, or over these and more."""

    @property
    def noise(self) -> float: ...
    def evaluate(self, x: Point, /) -> tuple[float, Slope]: ...
    def direction(
        self, x: Point, gradient: Slope, tolerance: float, max_iterations: int, convex: bool = False
    ) -> DirectionOf[Step]: ...
    def moved(self, x: Point, step: Step, length: float, /) -> Point: ...
    def longest(self, x: Point, step: Step, /) -> float:
        """The largest length of a step; infinite where nothing limits it."""
        ...

    def allows(self, x: Point, /) -> bool:
        """Whether the line search may go to x."""
        ...

    def slope(self, gradient: Slope, step: Step, /) -> float: ...
    def stepped(self, x: Point, step: Step, length: float, before: Slope, after: Slope, /) -> bool: ...
    def force_scale(self, x: Point, gradient: Slope, /) -> float: ...
    def energy_scale(self, x: Point, /) -> float: ...


@dataclass(frozen=True, eq=False)
class NewtonResult(Generic[Point]):
    """x: where it ended; energy, gradient: E and E' (n, dim) by the nodes there, not projected; negative_curvature: a
    direction of it, None if none was seen; seconds: of this rank's processor."""

    x: Point
    gradient: Array
    status: Status
    residual: float
    decrement: float
    newton_iterations: int
    cg_iterations: int
    energy: float
    seconds: float
    negative_curvature: Array | None

    @property
    def converged(self) -> bool:
        return self.status is Status.CONVERGED


def minimise(
    problem: Problem[Point, Slope, Step], x0: Point, settings: FullSpaceSettings
) -> NewtonResult[Point]:
    """Minimise from x0, positions (n, dim) of nodes for a `TotalEnergy`, which must satisfy the constraint."""
    start = time.process_time()
    x = x0
    energy, gradient = problem.evaluate(x)
    residual, decrement = gradient.norm / problem.force_scale(x, gradient), np.inf
    status, iteration, cg_total, eta = Status.MAX_ITERATIONS, 0, 0, settings.cg_tolerance
    direction: Array | None = None
    finite = bool(np.isfinite(energy) and np.isfinite(gradient.norm))
    if not finite:
        status = Status.NOT_FINITE
    while finite and iteration < settings.newton.max_iterations:
        iteration += 1
        cg = problem.direction(x, gradient, eta, settings.cg_max_iterations)
        cg_total += cg.iterations
        direction, convex = cg.direction, not cg.negative_curvature
        if not convex:
            if residual <= settings.newton.tolerance:
                status = Status.UNSTABLE
                break
            cg = problem.direction(x, gradient, eta, settings.cg_max_iterations, convex=True)
            cg_total += cg.iterations
        found = _line_search(problem, x, energy, cg, settings.line_search_halvings)
        if found is None:
            # A step below round-off is no failure if the residual is already below tolerance.
            decrement = -0.5 * cg.slope / problem.energy_scale(x)
            met = residual <= settings.newton.tolerance and decrement <= settings.decrement_tolerance
            status = Status.CONVERGED if met else Status.LINE_SEARCH_FAILED
            break
        previous = gradient
        length, x, energy, gradient = found
        changed = problem.stepped(x, cg.step, length, previous, gradient)
        if changed:
            energy, gradient = problem.evaluate(x)
        residual = gradient.norm / problem.force_scale(x, gradient)
        decrement = -0.5 * cg.slope / problem.energy_scale(x)
        # The length of a step is meaningless if its energy decrease is below round-off.
        full_step = length == 1.0 or -cg.slope <= _round_off(problem, energy)
        if (
            full_step
            and convex
            and not changed
            and residual <= settings.newton.tolerance
            and decrement <= settings.decrement_tolerance
        ):
            status = Status.CONVERGED
            break
        eta = _forcing(gradient.norm / previous.norm, eta, residual, settings)
    return NewtonResult(
        x=x,
        gradient=gradient.whole,
        status=status,
        residual=residual,
        decrement=decrement,
        newton_iterations=iteration,
        cg_iterations=cg_total,
        energy=energy,
        seconds=time.process_time() - start,
        negative_curvature=direction,
    )


def _forcing(fall: float, eta: float, residual: float, settings: FullSpaceSettings) -> float:
    """Tolerance of the next linear solve by Eisenstat and Walker's choice 2, safeguarded against a sudden drop of the
    residual, and against oversolving in the last step: it is at least half of what just meets the nonlinear
    tolerance."""
    proposed = 0.9 * fall**2
    if 0.9 * eta**2 > 0.1:
        proposed = max(proposed, 0.9 * eta**2)
    enough = 0.5 * settings.newton.tolerance / residual if residual > 0 else settings.cg_tolerance
    return float(np.clip(max(proposed, enough), settings.cg_tolerance_min, settings.cg_tolerance))


def _round_off(problem: Problem[Point, Slope, Step], energy: float) -> float:
    """Energy differences below this are round-off [J]."""
    return max(1e-12 * abs(energy), problem.noise)


def _line_search(
    problem: Problem[Point, Slope, Step], x: Point, energy: float, direction: DirectionOf[Step], halvings: int
) -> tuple[float, Point, float, Slope] | None:
    """Backtrack until Armijo's condition holds: (length, x, energy, gradient), or None.

    If the predicted change is below the round-off of the energy, the slope at the end of the step decides
    instead (the approximate Wolfe condition of Hager and Zhang 2005).
    """
    noise, step, slope = _round_off(problem, energy), direction.step, direction.slope
    longest = problem.longest(x, step)
    length = min(1.0, longest)
    for _ in range(halvings + 1):
        trial = problem.moved(x, step, length)
        if not problem.allows(trial):
            length *= 0.5
            continue
        # Most trials are accepted, and both cost hardly more than one.
        value, gradient = problem.evaluate(trial)
        if np.isfinite(value):
            if value <= energy + 1e-4 * length * slope:
                return _extended(problem, x, energy, direction, (length, trial, value, gradient), longest)
            end = abs(problem.slope(gradient, step))
            if value <= energy + noise and end <= 0.9 * abs(slope):
                return length, trial, value, gradient
        length *= 0.5
    return None


def _extended(
    problem: Problem[Point, Slope, Step],
    x: Point,
    energy: float,
    direction: DirectionOf[Step],
    found: tuple[float, Point, float, Slope],
    longest: float,
) -> tuple[float, Point, float, Slope]:
    """Twice as far, and so on, while the energy falls more and more steeply.

    Beside a saddle the step is that of a convex model, and away from the saddle as short as the body is close to it:
    without this, some tens of iterations creep away, each a little longer than the last.
    """
    step, slope = direction.step, direction.slope
    while problem.slope(found[3], step) <= slope and 2.0 * found[0] <= longest:
        length = 2.0 * found[0]
        trial = problem.moved(x, step, length)
        if not problem.allows(trial):
            break
        value, gradient = problem.evaluate(trial)
        if not (np.isfinite(value) and value <= energy + 1e-4 * length * slope and value < found[2]):
            break
        found = length, trial, value, gradient
    return found
