"""Newton's method with truncated projected CG and a line search: every full-space solve, static or dynamic.

Minimises E(x) over x0 + (null space). A solve counts as converged only if BOTH measures are below tolerance:

    residual   = |P E'(x)| / force scale                        (how well forces balance)
    decrement  = 1/2 d^T H d / energy scale ~ 1/2 (|error| / |displacement|)^2 in the energy norm

with d the Newton step. The residual alone does not bound the error of the displacement (DESIGN.md, part 5):
soft, smooth modes carry much displacement and hardly any force. A decrement of 1e-4 means an error of about 1
%. The decrement is that of the last full step taken, so what is returned is better than its figure by that
step.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from fem_truth.projected_cg import projected_cg
from fem_truth.total_energy import Gradient, TotalEnergy
from runtime.arrays import Array


class Status(IntEnum):
    """How a solve ended. The numbers go into truth files: never renumber."""

    CONVERGED = 0
    MAX_ITERATIONS = 1
    LINE_SEARCH_FAILED = 2
    UNSTABLE = 3
    NOT_FINITE = 4

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]


_SENTENCES = {
    Status.CONVERGED: "Forces balance and the Newton decrement is below tolerance.",
    Status.MAX_ITERATIONS: "The iterations ran out before both tolerances were met: allow more, or start "
    "nearer (approach a deep contact in smaller steps).",
    Status.LINE_SEARCH_FAILED: "No step along the Newton direction lowers the energy: the tolerances may be "
    "below round-off, or the start has inverted cells.",
    Status.UNSTABLE: "Forces balance, but the energy has negative curvature there: a saddle, from which the "
    "body would snap away.",
    Status.NOT_FINITE: "The energy or its gradient is not finite at the start: inverted cells in a material "
    "that resists inversion with infinite energy, or positions that are not numbers.",
}


@dataclass(frozen=True)
class NewtonSettings:
    """gradient_tolerance, decrement_tolerance: see the module; max_iterations: of Newton.

    cg_tolerance: loosest relative residual asked of the linear solver; it tightens as the square of the fall
    of the nonlinear residual (Eisenstat and Walker 1996, choice 2), not below cg_tolerance_min.
    cg_max_iterations: of CG in one Newton iteration. line_search_halvings: how often a step may be halved.
    """

    gradient_tolerance: float = 3e-4
    decrement_tolerance: float = 1e-4
    max_iterations: int = 60
    cg_tolerance: float = 0.1
    cg_tolerance_min: float = 1e-3
    cg_max_iterations: int = 2000
    line_search_halvings: int = 25


@dataclass(frozen=True, eq=False)
class NewtonResult:
    x: Array
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


def minimise(problem: TotalEnergy, x0: Array, settings: NewtonSettings) -> NewtonResult:
    """Minimise from x0 (n, dim), which has to satisfy the constraint already."""
    start = time.process_time()
    x = x0
    energy, gradient = problem.evaluate(x)
    residual, decrement = gradient.norm / problem.force_scale(x, gradient), np.inf
    status, iteration, cg_total, eta = Status.MAX_ITERATIONS, 0, 0, settings.cg_tolerance
    direction: Array | None = None
    finite = bool(np.isfinite(energy) and np.isfinite(gradient.norm))
    if not finite:
        status = Status.NOT_FINITE
    while finite and iteration < settings.max_iterations:
        iteration += 1
        cg = projected_cg(
            problem.hessian(x), gradient.projected, problem.null_space, eta, settings.cg_max_iterations
        )
        cg_total += cg.iterations
        direction = cg.direction
        if direction is not None:
            if residual <= settings.gradient_tolerance:
                status = Status.UNSTABLE
                break
            convex = problem.hessian(x, convex=True)
            cg = projected_cg(convex, gradient.projected, problem.null_space, eta, settings.cg_max_iterations)
            cg_total += cg.iterations
        found = _line_search(problem, x, energy, cg.step, cg.slope, settings.line_search_halvings)
        if found is None:
            # A step too small for round-off to see is no failure if the balance it should improve is there.
            decrement = -0.5 * cg.slope / problem.energy_scale(x)
            met = residual <= settings.gradient_tolerance and decrement <= settings.decrement_tolerance
            status = Status.CONVERGED if met else Status.LINE_SEARCH_FAILED
            break
        previous = gradient
        length, x, energy, gradient = found
        changed = problem.stepped(x, length * cg.step, previous, gradient)
        if changed:
            energy, gradient = problem.evaluate(x)
        residual = gradient.norm / problem.force_scale(x, gradient)
        decrement = -0.5 * cg.slope / problem.energy_scale(x)
        # The length of a step whose gain drowns in round-off says nothing.
        full_step = length == 1.0 or -cg.slope <= _round_off(problem, energy)
        if (
            full_step
            and direction is None
            and not changed
            and residual <= settings.gradient_tolerance
            and decrement <= settings.decrement_tolerance
        ):
            status = Status.CONVERGED
            break
        eta = _forcing(gradient.norm / previous.norm, eta, residual, settings)
    return NewtonResult(
        x, status, residual, decrement, iteration, cg_total, energy, time.process_time() - start, direction
    )


def _forcing(fall: float, eta: float, residual: float, settings: NewtonSettings) -> float:
    """Eisenstat and Walker's choice 2 for the next linear solve, safeguarded against a sudden fall of the
    residual, and against solving more than the last step needs: to half of what would just meet the
    tolerance."""
    proposed = 0.9 * fall**2
    if 0.9 * eta**2 > 0.1:
        proposed = max(proposed, 0.9 * eta**2)
    enough = 0.5 * settings.gradient_tolerance / residual if residual > 0 else settings.cg_tolerance
    return float(np.clip(max(proposed, enough), settings.cg_tolerance_min, settings.cg_tolerance))


def _round_off(problem: TotalEnergy, energy: float) -> float:
    """Differences of energy below this say nothing [J]."""
    return max(1e-12 * abs(energy), problem.noise)


def _line_search(
    problem: TotalEnergy, x: Array, energy: float, step: Array, slope: float, halvings: int
) -> tuple[float, Array, float, Gradient] | None:
    """Backtrack until Armijo's condition holds: (length, x, energy, gradient), or None.

    Where the predicted change drowns in the round-off of the energy, the slope at the end of the step decides
    instead (the approximate Wolfe condition of Hager and Zhang 2005).
    """
    noise = _round_off(problem, energy)
    length = 1.0
    for _ in range(halvings + 1):
        trial = x + length * step
        value, gradient = problem.evaluate(trial)  # most trials are taken, and both cost hardly more than one
        if np.isfinite(value):
            if value <= energy + 1e-4 * length * slope:
                return length, trial, value, gradient
            end = abs(problem.null_space.share.dot(gradient.projected, step))
            if value <= energy + noise and end <= 0.9 * abs(slope):
                return length, trial, value, gradient
        length *= 0.5
    return None
