"""The energy of one step in full space: elasticity, inertia, weight, springs, contact and lagged friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from softprint.fem_truth.dynamics.full_space_handles import FullSpaceHandles
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.potentials import Potential
from softprint.fem_truth.energy.surface_contact import LaggedFriction, SurfaceContact
from softprint.fem_truth.energy.total_energy import ElasticTangent, Gradient, TotalEnergy
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.lagged_friction import EARLY_UPDATES, NEARLY_BALANCED


class Contact(Potential, Protocol):
    """Contact with one collider at one pose, by a penalty or by a barrier."""

    @property
    def pose(self) -> RigidPose: ...
    @property
    def nodes(self) -> IntArray:
        """The nodes that contact may act on."""
        ...

    def touched(self, x: Array) -> IntArray: ...
    def max_depth(self, x: Array) -> float: ...


class StepParts(NamedTuple):
    """The potentials of a step other than elasticity: smooth ones by name; contact and friction by collider."""

    smooth: Mapping[str, Sequence[Potential]]
    contacts: Mapping[str, Contact]
    friction: Mapping[str, LaggedFriction]


class StepEnergy(TotalEnergy):
    """The energy of one step. Force scale: the largest of the forces that balance each other. null_space: that
    of the handles."""

    def __init__(
        self,
        elastic: FullSpaceElasticity,
        tangent: ElasticTangent,
        null_space: NullSpace,
        handles: FullSpaceHandles,
        parts: StepParts,
        friction_updates: int,
        force_floor: float,
    ) -> None:
        smooth = [term for group in parts.smooth.values() for term in group]
        super().__init__(
            elastic, (*smooth, *parts.contacts.values(), *parts.friction.values()), null_space, tangent
        )
        self._handles = handles
        self._contacts, self._friction = parts.contacts, parts.friction
        # The call of `lag_friction` at the start counts as the first update.
        self._updates_left = friction_updates - 1 if parts.friction else 0
        self._early_left = EARLY_UPDATES
        self._floor = force_floor

    def null_space_at(self, x: Array, forces: Array | None = None, convex: bool = False) -> NullSpace:
        return self._handles.null_space_at(self.null_space, x, forces, convex)

    def moved(self, x: Array, step: Array, length: float) -> Array:
        return self._handles.moved(x, length * step)

    def hold(self, x: Array) -> None:
        """Sharp points press the places that are nearest to them at x."""
        for contact in self._contacts.values():
            if isinstance(contact, SurfaceContact):  # a barrier has no sharp points
                contact.hold(x)

    def lag_friction(self, x: Array) -> None:
        """Update the normal forces of friction to those at x."""
        for name, friction in self._friction.items():
            contact = self._contacts[name]
            assert isinstance(contact, SurfaceContact)  # a barrier has no friction
            friction.lag(contact.bearing(x))

    def stepped(self, x: Array, step: Array, length: float, before: Gradient, after: Gradient) -> bool:
        """See `TotalEnergy.stepped`. Normal forces are far from the result before forces nearly balance: updates count
        from there on, as in `runtime/dynamics/step/step_solve.py`."""
        changed = super().stepped(x, step, length, before, after)
        if self._updates_left == 0:
            return changed
        if after.norm <= NEARLY_BALANCED * self.force_scale(x, after):
            self._updates_left -= 1
        elif self._early_left:
            self._early_left -= 1
        else:
            return changed
        self.lag_friction(x)
        return True

    def force_scale(self, x: Array, gradient: Gradient) -> float:
        contact = sum((contact.gradient(x) for contact in self._contacts.values()), np.zeros_like(x))
        null_space = self.null_space_at(x)
        elastic = float(np.linalg.norm(null_space.project(gradient.elastic)))
        return max(elastic, float(np.linalg.norm(null_space.project(contact))), self._floor)

    def energy_scale(self, x: Array) -> float:
        """1 J: a step is accepted on its residual alone, because inertia leaves no soft modes."""
        return 1.0
