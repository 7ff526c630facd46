"""The minimisation of a step, and the outer loop that updates the normal forces of friction.

Coulomb friction has no potential, so each minimisation keeps its normal forces fixed (lagged friction, Li et al. 2020).
They are updated at the start and after each of the first iterations, `updates` times in all; then they stay fixed until
the forces balance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from softprint.runtime.contact.lagged_friction import SlipStart
from softprint.runtime.dynamics.step.step_energy import StepEnergy, StepPoint
from softprint.runtime.optimise import Minimum, Optimiser, Status


@dataclass(frozen=True, eq=False)
class SlidingStep:
    """slip: the start from which slip is measured; updates: how often normal forces are updated."""

    slip: SlipStart
    updates: int


def solve_step(
    problem: StepEnergy, start: StepPoint, optimiser: Optimiser, sliding: SlidingStep | None
) -> Minimum[StepPoint]:
    """Minimises the energy of a step; sliding: None without friction."""
    if sliding is None:
        return optimiser.minimise(problem, start, problem.timings.solve)
    body, left = start.body, optimiser.max_iterations
    earlier: Minimum[StepPoint] | None = None
    for update in range(1, sliding.updates + 1):
        lagged = replace(problem, lagged=problem.lag(problem.point(body), sliding.slip))
        method = optimiser.limited(left if update == sliding.updates else 1)
        point = lagged.point(body)
        earlier = solved = method.minimise(lagged, point, problem.timings.solve, earlier)
        body, left = solved.x.body, left - solved.iterations
        # A minimum that took a step to reach is one for the normal forces of before that step.
        renew = solved.status is Status.MAX_ITERATIONS or (solved.converged and solved.iterations > 0)
        if left == 0 or not renew:
            break
    return replace(solved, iterations=optimiser.max_iterations - left)


def with_contact_checked(solved: Minimum[StepPoint]) -> Minimum[StepPoint]:
    """The minimum, with the status CONTACT_UNSOLVED where the handles balance but the contact solve has failed."""
    if solved.converged and not solved.x.contact_converged:
        return replace(solved, status=Status.CONTACT_UNSOLVED)
    return solved
