"""The minimisation of a step, and the outer loop that updates the normal forces of friction.

Coulomb friction has no potential, so each minimisation keeps its normal forces fixed (lagged friction, Li et al. 2020).
They are updated at the start, and after iterations that began where forces nearly balance, `updates` times in all; then
they stay fixed until the forces balance. Before forces nearly balance they are updated as well, since friction by the
normal forces of a start deep in a collider holds a step back, but only in the first iterations, and without counting:
between rigid surfaces such normal forces are far from the result, and would be held.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.lagged_friction import EARLY_UPDATES, NEARLY_BALANCED, SlipStart
from softprint.runtime.dynamics.step.step_energy import StepEnergy, StepPoint
from softprint.runtime.optimise import Minimum, Optimiser, Status


@dataclass(frozen=True, eq=False)
class SlidingStep:
    """slip: the start from which slip is measured; updates: how often normal forces are updated; friction: forces of
    condensed contact there, None without any."""

    slip: SlipStart
    updates: int
    friction: FrictionForces | None


def solve_step(
    problem: StepEnergy, start: StepPoint, optimiser: Optimiser, sliding: SlidingStep | None
) -> Minimum[StepPoint]:
    """Minimises the energy of a step; sliding: None without friction."""
    if sliding is None:
        return optimiser.minimise(problem, start, problem.timings.solve)
    updates, early, left = sliding.updates - 1, EARLY_UPDATES, optimiser.max_iterations
    lagged = replace(problem, lagged=problem.lag(start, sliding.slip, sliding.friction))
    point, earlier = lagged.point(start.body), None
    while True:
        method = optimiser.limited(1 if updates else left)
        earlier = solved = method.minimise(lagged, point, problem.timings.solve, earlier)
        point, left = solved.x, left - solved.iterations
        # A minimum that took a step to reach is one for the normal forces of before that step.
        moved = solved.status is Status.MAX_ITERATIONS or (solved.converged and solved.iterations > 0)
        if not (updates and left and moved):
            return replace(solved, iterations=optimiser.max_iterations - left)
        if solved.residual <= NEARLY_BALANCED:
            updates -= 1
        elif early:
            early -= 1
        else:
            continue
        friction = point.friction_on_nodes
        point = problem.point(point.body.under(friction))
        lagged = replace(problem, lagged=problem.lag(point, sliding.slip, friction))
        point = lagged.point(point.body)


def with_inner_solves_checked(solved: Minimum[StepPoint]) -> Minimum[StepPoint]:
    """The minimum, with the status CONTACT_UNSOLVED or CORRECTION_UNSOLVED where the handles balance but the contact
    solve, or that of an internal correction, has failed."""
    if solved.converged and not solved.x.body.correction_converged:
        return replace(solved, status=Status.CORRECTION_UNSOLVED)
    if solved.converged and not solved.x.contact_converged:
        return replace(solved, status=Status.CONTACT_UNSOLVED)
    return solved
