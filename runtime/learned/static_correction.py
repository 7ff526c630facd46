"""Corrections evaluated state by state, outside of dynamics: for reports, benchmarks and training."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.contact.solver.warm_start import TOO_FAR
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.learned.correction import ContactCorrection, Correction

# Of a way that is too long for a prediction, how far the body moves at most in each part, as a multiple of the contact
# displacement before it, and the number of parts at most.
_PART, _MOST_PARTS = 0.5, 16


class StaticCorrection:
    """A correction at nodes (n,) of a body, all by default; internal: correction of the body, which contact sees.
    Solved contacts are arguments and results."""

    def __init__(
        self,
        correction: Correction,
        body: ReducedBody,
        nodes: IntArray | None = None,
        internal: InternalField | None = None,
    ) -> None:
        points = body.node_points(nodes)
        self._name, self._shape = correction.collider, points.rest.shape
        if isinstance(correction, ContactCorrection):
            colliders = {correction.collider: correction.shape}
            own = correction.law, correction.band, correction.learned, internal
            self._contact: CondensedContact | None = CondensedContact.of(
                body, correction.mechanics, colliders, *own
            )
            self._bound = correction.bind(points, self._contact, correction.collider)
        else:
            self._contact, self._field = None, correction.bind(points)
        condensation = (
            correction.mechanics.condensation if isinstance(correction, ContactCorrection) else None
        )
        self._condensation = condensation if condensation is None or nodes is None else condensation.at(nodes)

    def solve(self, rows: Array, pose: RigidPose, near: SolvedContact | None) -> SolvedContact | None:
        """The contact at handle rows (n_rows, dim). near: warm start, a solved contact; where it is too far away to
        predict from, contact is followed on the straight way from there, in steps. None for a field correction, or
        without contact."""
        if self._contact is None:
            return None
        if near is None:
            return self._step(rows, pose, None)
        solved: SolvedContact | None = near
        parts, start = self._parts(rows, pose, near), near.poses[self._name]
        for t in np.arange(1, parts) / parts:
            solved = self._step(near.rows + t * (rows - near.rows), start.towards(pose, t), solved)
        return self._step(rows, pose, solved)

    def _parts(self, rows: Array, pose: RigidPose, near: SolvedContact) -> int:
        """The number of steps on the way from a solved contact: one for any that can be predicted from."""
        assert self._contact is not None
        moved = self._contact.moved(self._contact.in_frame(rows), rows, {self._name: pose}, near)
        if near.depth == 0.0 or moved <= TOO_FAR * near.depth:
            return 1
        return min(math.ceil(moved / (_PART * near.depth)), _MOST_PARTS)

    def _step(self, rows: Array, pose: RigidPose, near: SolvedContact | None) -> SolvedContact | None:
        """The contact at handle rows (n_rows, dim), in a frame of its own, as in the first evaluation of a step."""
        assert self._contact is not None
        points, start = self._contact.in_frame(rows), self._contact.resume(near)
        return self._contact.evaluate(points, rows, {self._name: pose}, start).solved

    def confidence(self, solved: SolvedContact | None) -> float | None:
        """The factor in [0, 1] that reduces the correction outside the range of training; None without contact, and for
        a correction without one."""
        # Imported here, because torch takes a second to load and other corrections do not need it.
        from softprint.runtime.learned.force.correction import BoundForceCorrection

        if solved is None or self._contact is None or not isinstance(self._bound, BoundForceCorrection):
            return None
        return self._bound.confidence(solved)

    def displacement(self, rows: Array, pose: RigidPose, near: SolvedContact | None = None) -> Array:
        """u (n, dim) [m] by contact, in the world frame; near: see `solve`."""
        return self.displacement_of(self.solve(rows, pose, near), rows, pose)

    def displacement_of(self, solved: SolvedContact | None, rows: Array, pose: RigidPose) -> Array:
        """u (n, dim) [m] from a contact that `solve` returned there."""
        if self._contact is None:
            return self._field.displacement(rows, pose)
        return np.zeros(self._shape) if solved is None else self._bound.displacement(solved)

    def displacement_along(self, rows: Array, poses: Sequence[RigidPose]) -> Array:
        """u (n, dim) [m] at the last of several poses, with the contact followed along them from no contact."""
        near = None
        for pose in poses[:-1]:
            near = self.solve(rows, pose, near)
        return self.displacement(rows, poses[-1], near)

    def condensed_displacement(self, rows: Array) -> Array:
        """(n, dim) [m] by static condensation, without contact; zero for a correction without static condensation."""
        if self._condensation is None:
            return np.zeros(self._shape)
        return self._condensation.corotated(rows).displacement(rows)
