"""Where Newton's method starts in a step.

At constant velocity, where nothing more is known. After a step whose forces balance more is: the forces c of contact
at its end, and the Hessian H of its last iteration, both by the unknowns. With all other forces g found anew at the
rows of then, but led handles where they have to be,

    v = -H^-1 (g + c)

goes where an iteration would go, and takes no look at contact, the dear part of it. Contact that depends on more than
the body's own state, on colliders that move or on how far friction has been rubbed along, is not what it was: then,
too, the velocity is all there is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array
from runtime.body.body import ReducedBody
from runtime.colliders.pose import Poses
from runtime.dynamics.kinematic import KinematicHandle, place_kinematic
from runtime.dynamics.newton import Descent, NewtonResult
from runtime.dynamics.state import Configuration, ReducedState
from runtime.dynamics.step_energy import StepEnergy


@dataclass(frozen=True, eq=False)
class _Known:
    """Of the state that a step led to: c (n,) [N], and H."""

    state: ReducedState
    contact: Array
    descent: Descent


class StepStart:
    """Of the steps of one body, one after the other; time_step [s]."""

    def __init__(self, body: ReducedBody, kinematic: Sequence[KinematicHandle], time_step: float) -> None:
        self._body, self._kinematic, self._time_step = body, tuple(kinematic), time_step
        self._known: _Known | None = None
        self._foretold_by: Descent | None = None  # if this step was foretold

    def __call__(self, state: ReducedState, energy: StepEnergy, time: float, poses: Poses) -> Configuration:
        """Of the step from a state, with this energy, to a time [s] when colliders are at these poses."""
        known, self._foretold_by = self._known, None
        if known is not None and known.state is state and _alike(state.poses, poses):
            at = Configuration(self._led(state.rows, time), poses)
            slope = energy.slope(at, known.contact)
            self._foretold_by = known.descent
            return energy.retract(at, known.descent(slope))
        return Configuration(self._carried_on(state, time), poses)

    def _carried_on(self, state: ReducedState, time: float) -> Array:
        """Rows at constant velocity, frames kept rigid."""
        handles = self._body.handles
        change = self._time_step * state.rows_velocity
        return self._led(handles.retract(state.rows, handles.increment(state.rows, change)), time)

    def _led(self, rows: Array, time: float) -> Array:
        """With the handles that are led where they have to be."""
        return place_kinematic(rows, self._body.rest_rows, self._body.handles, self._kinematic, time)

    def learn(self, solved: NewtonResult[Configuration], reached: ReducedState, energy: StepEnergy) -> None:
        """From a step that led to a state."""
        self._known = None
        # A step that starts in balance takes none of its own: what told where is still good.
        descent = solved.descent or self._foretold_by
        if solved.converged and energy.contact_seen is not None and descent is not None:
            self._known = _Known(reached, energy.contact_seen, descent)


def _alike(one: Poses, other: Poses) -> bool:
    """Whether all of them are where they were."""
    return all(
        pose is other[name]
        or (
            np.array_equal(pose.rotation, other[name].rotation)
            and np.array_equal(pose.translation, other[name].translation)
        )
        for name, pose in one.items()
    )
