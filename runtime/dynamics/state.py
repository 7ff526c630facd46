"""What a simulator steps from and to, and what it says about a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Generic, NamedTuple, TypeVar

from runtime.arrays import Array
from runtime.colliders.pose import RigidPose
from runtime.contact.contact_force import ContactForce
from runtime.rigid.flight import RigidMotion

State = TypeVar("State")


class Configuration(NamedTuple):
    """What a step solves for: handle rows (n_rows, dim) and where every collider is; of these only those move that move
    freely."""

    rows: Array
    poses: Mapping[str, RigidPose]


@dataclass(frozen=True, eq=False)
class ReducedState:
    """time [s]; rows (n_rows, dim): handle rows; rows_velocity (n_rows, dim): their rates; poses: where each
    collider stands at this time; turn (n_rows, dim): the handle rows at which the internal response of the body was
    turned in the step that led here, None where no step did; motions: how the colliders move that move freely."""

    time: float
    rows: Array
    rows_velocity: Array
    poses: Mapping[str, RigidPose]
    turn: Array | None = None
    motions: Mapping[str, RigidMotion] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class StepResult(Generic[State]):
    """One step, reduced or full.

    state: at its end; status: its `sentence` is advice, and 0 means converged; iterations: linear solves;
    residual: relative, as last seen by the solver (see `newton`); energies [J] and timings [s] by name;
    contacts by collider.
    """

    state: State
    status: IntEnum
    reason: str
    iterations: int
    residual: float
    energies: Mapping[str, float]
    timings: Mapping[str, float]
    contacts: Mapping[str, ContactForce]

    @property
    def converged(self) -> bool:
        return self.status == 0

    @property
    def penetration(self) -> float:
        """The deepest penetration of any collider [m]."""
        return max((contact.penetration for contact in self.contacts.values()), default=0.0)
