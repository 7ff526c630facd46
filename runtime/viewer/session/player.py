"""One model that plays in a session: its state, its last step, and how they pass to another model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from softprint.runtime.colliders import RigidPose
from softprint.runtime.dynamics.hold import held
from softprint.runtime.dynamics.kinematic import KinematicHandle
from softprint.runtime.dynamics.settings import DynamicsSettings
from softprint.runtime.dynamics.simulator import Simulator
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.dynamics.terms.springs import HandleSpring, PointSpring
from softprint.runtime.errors import SoftprintError
from softprint.runtime.rigid import RigidMotion
from softprint.runtime.viewer.session.workshop import Model

Motions = Mapping[str, RigidMotion]


class Player:
    """Steps one model. motions: of its free colliders at the start."""

    def __init__(self, model: Model, time: float, poses: Mapping[str, RigidPose], motions: Motions) -> None:
        self.model = model
        self.simulator: Simulator = model.simulator
        self.state = self._at_rest(time, poses, motions)
        self.result: StepResult[ReducedState] | None = None

    def restart(self, time: float, poses: Mapping[str, RigidPose], motions: Motions) -> None:
        """The body at rest, with the colliders at these poses."""
        self.state, self.result = self._at_rest(time, poses, motions), None

    def take_over(self, other: Player) -> None:
        """Go on from the shape and the velocity of the body of another model."""
        if other.state.rows.shape == self.state.rows.shape:
            self.state = replace(self.state, rows=other.state.rows, rows_velocity=other.state.rows_velocity)

    def hold(
        self,
        springs: Sequence[HandleSpring | PointSpring],
        kinematic: Sequence[KinematicHandle],
        settings: DynamicsSettings,
    ) -> None:
        """Hold the body otherwise from the next step on."""
        self.simulator = held(self.model.simulator, springs, kinematic, settings)
        self.state = replace(self.state, factorisation=None)

    def step(self, poses: Mapping[str, RigidPose]) -> StepResult[ReducedState]:
        """One step with the led colliders at these poses. Raises SoftprintError where no step is possible or its result
        is no number; the state is then the one before."""
        try:
            result = self.simulator.step(self.state, poses)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
            raise SoftprintError(f"the step failed: {error}") from error
        rows = result.state.rows
        if not (np.isfinite(rows).all() and np.isfinite(result.state.rows_velocity).all()):
            raise SoftprintError("the step ended with positions that are not numbers")
        self.state, self.result = result.state, result
        return result

    def _at_rest(self, time: float, poses: Mapping[str, RigidPose], motions: Motions) -> ReducedState:
        rows = self.model.rest_rows
        return ReducedState(time, rows, np.zeros_like(rows), dict(poses), dict(motions))
