"""The state of a simulation, and the result of a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.contact.contact_force import ContactForce, FrictionForces
from softprint.runtime.contact.piercing import Piercing
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.dynamics.terms.kept_elastic_hessian import KeptHessian
from softprint.runtime.optimise.descent import Descent
from softprint.runtime.rigid.flight import RigidMotion

State = TypeVar("State")


class Configuration(NamedTuple):
    """The unknowns of a step: handle rows (n_rows, dim) and the poses of all colliders, of which only free colliders
    move."""

    rows: Array
    poses: Poses


@dataclass(frozen=True, eq=False)
class KeptFactorisation:
    """free: (n_free,) the free minimal coordinates that are its unknowns; contact_gradient: of the contact energy by
    these (n_free,) [N] at a state whose forces balance; descent: the factorised Hessian of the last iteration before
    it."""

    free: IntArray
    contact_gradient: Array
    descent: Descent


@dataclass(frozen=True, eq=False)
class ReducedState:
    """time [s]; rows (n_rows, dim): handle rows; rows_velocity (n_rows, dim): their rates; poses: of all colliders at
    this time; motions: of the colliders that move freely; friction: of condensed contact on the body, which has given
    way to it.

    The warm start of the next step, plain data, None in a state without a previous step: frame_rows (n_rows, dim): the
    handle rows of the corotated frame of the previous step; contact: solved at this state, with its active set;
    factorisation: predicts the start of the next step; elastic_hessian: used again while the strain changes little.
    """

    time: float
    rows: Array
    rows_velocity: Array
    poses: Mapping[str, RigidPose]
    motions: Mapping[str, RigidMotion] = field(default_factory=dict)
    friction: FrictionForces | None = None
    frame_rows: Array | None = None
    contact: SolvedContact | None = None
    factorisation: KeptFactorisation | None = None
    elastic_hessian: KeptHessian | None = None

    @property
    def frame(self) -> Array:
        """The frame rows: the rows of the state itself without a previous step."""
        return self.rows if self.frame_rows is None else self.frame_rows

    @property
    def contact_is_here(self) -> bool:
        """Whether the contact that the state carries was solved at its rows and poses, and not at those of another
        state."""
        contact = self.contact
        if contact is None or not np.array_equal(contact.rows, self.rows):
            return False
        return all(at.is_at(self.poses[name]) for name, at in contact.poses.items())


@dataclass(frozen=True, eq=False)
class StepResult(Generic[State]):
    """One step, reduced or full.

    state: at its end; status: how the solve ended, with advice in its `sentence`; 0 means converged; iterations: linear
    solves; residual: relative, as last evaluated by the solver (see `newton`); energies [J] and timings [s] by name;
    contacts by collider; piercing: the deepest collider that has pierced the body or was kept from it, None where the
    status is not PIERCED.
    """

    state: State
    status: IntEnum
    reason: str
    iterations: int
    residual: float
    energies: Mapping[str, float]
    timings: Mapping[str, float]
    contacts: Mapping[str, ContactForce]
    piercing: Piercing | None = None

    @property
    def converged(self) -> bool:
        return self.status == 0

    @property
    def in_contact(self) -> bool:
        """Whether the body touches any collider."""
        return any(contact.points for contact in self.contacts.values())

    @property
    def penetration(self) -> float:
        """The deepest penetration of any collider [m]."""
        return max((contact.penetration for contact in self.contacts.values()), default=0.0)
