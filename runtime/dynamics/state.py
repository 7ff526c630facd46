"""What a simulator steps from and to, and what it says about a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.colliders.pose import RigidPose
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
class SurfaceLoads:
    """The forces (m, dim) [N] on a collider that a contact force is the sum of, at the points (m, dim) [m].

    nodes: (n,) the nodes of the mesh that could bear such, each for the part of the surface nearest to it; index: (m,)
    which of them do; tangential: whether it is friction.
    """

    nodes: IntArray
    index: IntArray
    points: Array
    forces: Array
    tangential: bool = False


@dataclass(frozen=True, eq=False)
class ContactForce:
    """What the body does to one collider at the end of a step.

    force (dim,) [N] on the collider, friction included; torque (1,) in 2D, (3,) in 3D [N m] about the origin
    of the collider's own frame; penetration: the deepest point [m]; points: how many surface points are in
    contact; loads: what it is the sum of.
    """

    force: Array
    torque: Array
    penetration: float
    points: int
    loads: Sequence[SurfaceLoads] = ()


def resultant(loads: Sequence[SurfaceLoads], origin: Array) -> tuple[Array, Array]:
    """Force (dim,) and torque about ``origin`` of loads."""
    dim = len(origin)
    force, torque = np.zeros(dim), np.zeros(1 if dim == 2 else 3)
    for load in loads:
        arm, forces = load.points - origin, load.forces
        force += forces.sum(axis=0)
        if dim == 2:
            torque += (arm[:, 0] * forces[:, 1] - arm[:, 1] * forces[:, 0]).sum()
        else:
            torque += np.cross(arm, forces).sum(axis=0)
    return force, torque


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
