"""A step whose learned energy has no minimum within reach, with the hardening of contact held.

The energies of a dent are functions of the contact forces of linear mechanics. Where one equilibrium of these ends, as
where a point of the body is about to slide around a thin rod, they change without bound, and so do these energies,
though that of mechanics does not. The learned energy W~ may fall all the way to that end, and beyond it be higher: then
it has no minimum there. Such a step is taken with c W, the energy of mechanics times the ratio c of the forces of W~
and W at its start. It says so by its status. A step that is given only a few iterations, as in real time, need not have
come to a minimum, and is left as it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.dynamics.step.step_energy import StepEnergy, StepPoint
from softprint.runtime.dynamics.step.step_solve import SlidingStep, solve_step, with_inner_solves_checked
from softprint.runtime.optimise import Minimum, Optimiser, Status

# Fewer iterations than these say nothing of a minimum.
_ENOUGH = 10


def solve_or_hold(
    problem: StepEnergy,
    point: StepPoint,
    begin: BodyEvaluation,
    optimiser: Optimiser,
    sliding: SlidingStep | None,
) -> Minimum[StepPoint]:
    """Minimises the energy of a step from a point; begin: the body at the start of the step, in its frame."""
    solved = solve_step(problem, point, optimiser, sliding)
    ran_out = solved.status is Status.MAX_ITERATIONS and optimiser.max_iterations < _ENOUGH
    held = None if solved.converged or ran_out else _with_hardening_held(begin)
    if held is None:
        return solved
    again = solve_step(problem, problem.point(held.near(point.body.at)), optimiser, sliding)
    again = replace(again, iterations=solved.iterations + again.iterations)
    if not with_inner_solves_checked(again).converged:
        return replace(solved, iterations=again.iterations)
    return replace(again, status=Status.HARDENING_HELD)


def _with_hardening_held(begin: BodyEvaluation) -> BodyEvaluation | None:
    """The body with the hardening of its contact held; None where nothing is learned."""
    frame, contact = begin.frame, begin.contact
    condensed = frame.terms.condensed
    if condensed is None or condensed.learned is None or contact is None:
        return None
    learned = condensed.learned.held(_force_ratio(contact))
    terms = replace(frame.terms, condensed=replace(condensed, learned=learned))
    return BodyEvaluation(
        terms.in_frame(frame.rows, frame.friction), begin.at, contact.warm_start, begin.kept_hessian, begin.timings
    )


def _force_ratio(contact: ContactEvaluation) -> float:
    """c, by least squares over the handles; one where nothing touches the body, or the forces are opposed."""
    if contact.contact is None:
        return 1.0
    of_mechanics = contact.contact.gradient
    size = float(np.vdot(of_mechanics, of_mechanics))
    ratio = float(np.vdot(contact.gradient, of_mechanics)) / size if size > 0.0 else 0.0
    return ratio if ratio > 0.0 else 1.0
