"""Newton's method with truncated projected CG and a line search: every full-space solve, static or dynamic.

Minimises E(x) over x0 + (null space). A solve counts as converged only if BOTH measures are below tolerance:

    residual   = |P E'(x)| / force scale                        (how well forces balance)
    decrement  = 1/2 d^T H d / energy scale ~ 1/2 (|error| / |displacement|)^2 in the energy norm

with d the Newton step. The residual alone does not bound the error of the displacement (DESIGN.md, part 5): soft,
smooth modes carry much displacement and hardly any force. A decrement of 1e-4 means an error of about 1 %.
The decrement is that of the last full step taken, so what is returned is better than its figure by that step.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np

from fem_truth.block_matrix import BlockMatrix
from fem_truth.null_space import NullSpace
from fem_truth.projected_cg import projected_cg
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
    Status.MAX_ITERATIONS: "The iterations ran out before both tolerances were met: allow more, or start nearer "
    "(approach a deep contact in smaller steps).",
    Status.LINE_SEARCH_FAILED: "No step along the Newton direction lowers the energy: the tolerances may be below "
    "round-off, or the start has inverted cells.",
    Status.UNSTABLE: "Forces balance, but the energy has negative curvature there: a saddle, from which the body "
    "would snap away.",
    Status.NOT_FINITE: "The energy or its gradient is not finite at the start: inverted cells in a material that "
    "resists inversion with infinite energy, or positions that are not numbers.",
}


@dataclass(frozen=True)
class NewtonSettings:
    """gradient_tolerance, decrement_tolerance: see the module; max_iterations: of Newton.

    cg_tolerance: loosest relative residual asked of the linear solver; it tightens as the square of the fall of the
    nonlinear residual (Eisenstat and Walker 1996, choice 2), not below cg_tolerance_min. cg_max_iterations: of CG
    in one Newton iteration. line_search_halvings: how often a step may be halved.
    """

    gradient_tolerance: float = 1e-4
    decrement_tolerance: float = 1e-4
    max_iterations: int = 60
    cg_tolerance: float = 0.1
    cg_tolerance_min: float = 1e-3
    cg_max_iterations: int = 2000
    line_search_halvings: int = 25


class Energy(Protocol):
    """What is minimised, and the two scales that residual [N] and decrement [J] are measured against at x."""

    def energy(self, x: Array) -> float: ...
    def gradient(self, x: Array) -> Array: ...
    def hessian(self, x: Array) -> BlockMatrix: ...
    def force_scale(self, x: Array) -> float: ...
    def energy_scale(self, x: Array) -> float: ...


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


def minimise(problem: Energy, null_space: NullSpace, x0: Array, settings: NewtonSettings) -> NewtonResult:
    """Minimise from x0 (n, dim), which has to satisfy the constraint already."""
    start = time.process_time()
    x, energy = x0, problem.energy(x0)
    decrement, status, cg_total, iteration = np.inf, Status.MAX_ITERATIONS, 0, 0
    direction: Array | None = None
    gradient = null_space.project(problem.gradient(x))
    norm, eta = float(np.linalg.norm(gradient)), settings.cg_tolerance
    residual = norm / problem.force_scale(x)
    if not (np.isfinite(energy) and np.isfinite(norm)):
        status = Status.NOT_FINITE
    for iteration in range(1, settings.max_iterations + 1) if status is not Status.NOT_FINITE else ():
        cg = projected_cg(problem.hessian(x), gradient, null_space, eta, settings.cg_max_iterations)
        cg_total += cg.iterations
        direction = cg.direction
        if cg.negative_curvature and residual <= settings.gradient_tolerance:
            status = Status.UNSTABLE
            break
        found = _line_search(problem, x, energy, cg.step, cg.slope, settings.line_search_halvings)
        if found is None:
            # A step too small for round-off to see is no failure if the balance it should improve is there.
            decrement = -0.5 * cg.slope / problem.energy_scale(x)
            met = residual <= settings.gradient_tolerance and decrement <= settings.decrement_tolerance
            status = Status.CONVERGED if met else Status.LINE_SEARCH_FAILED
            break
        length, x, energy, raw_gradient = found
        gradient = null_space.project(raw_gradient)
        norm, previous = float(np.linalg.norm(gradient)), norm
        residual = norm / problem.force_scale(x)
        decrement = -0.5 * cg.slope / problem.energy_scale(x)
        full_step = length == 1.0 and not cg.negative_curvature
        if full_step and residual <= settings.gradient_tolerance and decrement <= settings.decrement_tolerance:
            status = Status.CONVERGED
            break
        eta = _forcing(norm, previous, eta, settings)
    return NewtonResult(
        x, status, residual, decrement, iteration, cg_total, energy, time.process_time() - start, direction
    )


def _forcing(norm: float, previous: float, eta: float, settings: NewtonSettings) -> float:
    """Eisenstat and Walker's choice 2, safeguarded against a sudden fall."""
    proposed = 0.9 * (norm / previous) ** 2 if previous > 0 else settings.cg_tolerance_min
    if 0.9 * eta**2 > 0.1:
        proposed = max(proposed, 0.9 * eta**2)
    return float(np.clip(proposed, settings.cg_tolerance_min, settings.cg_tolerance))


def _line_search(
    problem: Energy, x: Array, energy: float, step: Array, slope: float, halvings: int
) -> tuple[float, Array, float, Array] | None:
    """Backtrack until Armijo's condition holds: (length, x, energy, full gradient), or None.

    Where the predicted change drowns in the round-off of the energy, the slope at the end of the step decides
    instead (the approximate Wolfe condition of Hager and Zhang 2005).
    """
    noise = 1e-12 * max(abs(energy), abs(slope))
    length = 1.0
    for _ in range(halvings + 1):
        trial = x + length * step
        value = problem.energy(trial)
        if np.isfinite(value):
            if value <= energy + 1e-4 * length * slope:
                return length, trial, value, problem.gradient(trial)
            if value <= energy + noise:
                gradient = problem.gradient(trial)
                if abs(float(np.vdot(gradient, step))) <= 0.9 * abs(slope):
                    return length, trial, value, gradient
        length *= 0.5
    return None
