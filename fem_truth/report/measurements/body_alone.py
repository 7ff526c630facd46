"""A body without a collider in a report: what stands for the collider, and internal corrections state by state, alone
and below a correction of contact."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import ColliderBase
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.mechanics.static_condensation import StaticCondensation


class NoCollider(ColliderBase):
    """Infinitely far from everything, so that nothing touches it and nothing of it is drawn."""

    name = "none"

    def __init__(self, dim: int) -> None:
        self.lower = self.upper = np.zeros(dim)

    def sdf(self, z: Array) -> Array:
        """See `Collider`."""
        return np.full(len(z), np.inf)


class InternalDisplacement:
    """Static condensation and an internal correction of all nodes, or one of the two, with the methods of a
    `StaticCorrection`: what it adds by contact is zero. internal: the correction, None for static condensation
    alone."""

    def __init__(
        self, body: ReducedBody, condensation: StaticCondensation | None, internal: InternalField | None
    ) -> None:
        self._shape, self._condensation = body.mesh.points.shape, condensation
        self.internal, self._bound = internal, None if internal is None else internal.bind()

    def solve(self, rows: Array, pose: RigidPose, near: SolvedContact | None) -> SolvedContact | None:
        """None: there is no contact to solve."""
        return None

    def displacement_of(self, solved: SolvedContact | None, rows: Array, pose: RigidPose) -> Array:
        """(n_nodes, dim) [m] by contact: zero."""
        return np.zeros(self._shape)

    def condensed_displacement(self, rows: Array) -> Array:
        """(n_nodes, dim) [m] without contact, at handle rows (n_rows, dim)."""
        u = np.zeros(self._shape)
        if self._condensation is not None:
            u += self._condensation.corotated(rows).displacement(rows)
        return u if self._bound is None else u + self._bound.displacement(rows)


class WithInternal:
    """A correction of contact that is added to an internal one, with the methods of a `StaticCorrection`."""

    def __init__(self, correction: StaticCorrection, internal: InternalDisplacement) -> None:
        self.solve, self.displacement_of = correction.solve, correction.displacement_of
        self.condensed_displacement = internal.condensed_displacement
