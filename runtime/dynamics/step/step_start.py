"""The starting point of the minimisation of a step.

By default the body continues at constant velocity. After a step whose forces balance, the state also stores the contact
gradient c at its end and the factorised Hessian H of its last iteration, both by the unknowns. With the gradient g of
all other energies at the same rows, but with moving kinematic handles at their new positions,

    v = -H^-1 (g + c)

is the step of a Newton iteration without the expensive contact evaluation. A body with an internal correction takes it
from constant velocity instead, since its Hessian changes faster with the state. Where contact has changed for other
reasons, because colliders have moved or friction has slipped, the start is again at constant velocity.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.runtime.arrays import Array, same
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.dynamics.kinematic import KinematicHandle, place_kinematic
from softprint.runtime.dynamics.state import Configuration, KeptFactorisation, ReducedState
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.dynamics.step.step_energy import StepEnergy, StepPoint
from softprint.runtime.optimise import Minimum
from softprint.runtime.optimise.descent import Descent


class StepStart:
    """Finds the starting points of the steps of one body; time_step [s]."""

    def __init__(self, body: ReducedBody, kinematic: Sequence[KinematicHandle], time_step: float) -> None:
        self._body, self._kinematic, self._time_step = body, tuple(kinematic), time_step

    def __call__(
        self, state: ReducedState, problem: StepEnergy, begin: BodyEvaluation, time: float, poses: Poses
    ) -> tuple[Configuration, Descent | None]:
        """The starting point of the step from a state to a time [s] with the colliders at poses, and the factorised
        Hessian that predicted it, None at constant velocity. begin: the body at the state, in the frame of the step."""
        kept = state.factorisation
        if kept is not None and same(kept.free, problem.unknowns.free) and _same_poses(state.poses, poses):
            at = (
                Configuration(self._at_constant_velocity(state, time), poses)
                if begin.frame.terms.points.corrected
                else self.at_rest(state, time, poses)
            )
            slope = problem.slope(begin.near(at), kept.contact_gradient)
            return problem.moved(at, kept.descent(slope)), kept.descent
        return Configuration(self._at_constant_velocity(state, time), poses), None

    def at_rest(self, state: ReducedState, time: float, poses: Poses) -> Configuration:
        """The state itself with the kinematic handles at their positions at a time [s], and colliders at poses."""
        return Configuration(self._placed(state.rows, time), poses)

    def _at_constant_velocity(self, state: ReducedState, time: float) -> Array:
        """Rows at constant velocity, frames kept rigid."""
        handles = self._body.handles
        change = self._time_step * state.rows_velocity
        return self._placed(handles.retract(state.rows, handles.increment(state.rows, change)), time)

    def _placed(self, rows: Array, time: float) -> Array:
        """Rows with the kinematic handles at their positions at a time [s]."""
        return place_kinematic(rows, self._body.rest_rows, self._body.handles, self._kinematic, time)


def kept_factorisation(solved: Minimum[StepPoint], predicted_by: Descent | None) -> KeptFactorisation | None:
    """The factorisation that predicts the next step. None where the forces do not balance, or where contact depends on
    more than the state of the body: with friction, free colliders or field corrections."""
    problem, x = solved.x.problem, solved.x
    points = x.body.frame.terms.points
    own_state_only = problem.lagged is None and problem.free_bodies is None and not points.by_colliders
    # A step that converges at its starting point factorises nothing: the factorisation that predicted it is kept.
    descent = solved.descent or predicted_by
    if not (solved.converged and own_state_only) or descent is None:
        return None
    return KeptFactorisation(problem.unknowns.free, x.contact_gradient, descent)


def _same_poses(one: Poses, other: Poses) -> bool:
    """Whether all poses are equal."""
    return all(
        pose is other[name]
        or (
            np.array_equal(pose.rotation, other[name].rotation)
            and np.array_equal(pose.translation, other[name].translation)
        )
        for name, pose in one.items()
    )
