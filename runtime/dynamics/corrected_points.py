"""Body points that dynamics watches, x = U rows + u(rows, poses), u being the sum of the corrections bound to
them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from runtime.arrays import Array
from runtime.body.material_points import MaterialPoints
from runtime.colliders.pose import RigidPose
from runtime.corrections.correction import BoundCorrection, Correction, CorrectionField
from runtime.dynamics.timings import Timings

Poses = Mapping[str, RigidPose]


class CorrectedPoints:
    """n material points with the corrections of some colliders.

    corrections: (name of the collider, correction); reach: see `Correction.bind`.
    """

    def __init__(
        self, points: MaterialPoints, corrections: Sequence[tuple[str, Correction]], reach: float = np.inf
    ) -> None:
        self.basis: Array = np.ascontiguousarray(points.basis)
        self._corrections: list[tuple[str, BoundCorrection]] = [
            (collider, correction.bind(points, reach)) for collider, correction in corrections
        ]

    @property
    def corrected(self) -> bool:
        """Whether there is any correction."""
        return bool(self._corrections)

    def reduced(self, rows: Array) -> Array:
        """U rows (n, dim) [m]."""
        return self.basis @ rows

    def displacement(self, rows: Array, poses: Poses, timings: Timings) -> Array | None:
        """u (n, dim) [m]; None where there is no correction at all."""
        if not self._corrections:
            return None
        with timings.correction:
            fields = [bound.displacement(rows, poses[collider]) for collider, bound in self._corrections]
            return sum(fields[1:], start=fields[0])

    def linearise(self, rows: Array, poses: Poses, timings: Timings) -> CorrectionField | None:
        """u and du/drows of the points where any correction is active; None where none is."""
        if not self._corrections:
            return None
        with timings.correction:
            fields = [bound.linearise(rows, poses[collider]) for collider, bound in self._corrections]
            active = [field for field in fields if len(field.index)]
            return _sum_of(active) if active else None

    def scatter(self, field: CorrectionField | None) -> Array | None:
        """The field's displacement at all n points, zero where it is inactive."""
        if field is None:
            return None
        displacement = np.zeros((len(self.basis), field.displacement.shape[1]))
        displacement[field.index] = field.displacement
        return displacement


def _sum_of(fields: Sequence[CorrectionField]) -> CorrectionField:
    """Several fields on the union of their points."""
    if len(fields) == 1:
        return fields[0]
    index = np.unique(np.concatenate([field.index for field in fields]))
    displacement = np.zeros((len(index), fields[0].displacement.shape[1]))
    jacobian = np.zeros((len(index), *fields[0].jacobian.shape[1:]))
    for field in fields:
        at = np.searchsorted(index, field.index)
        displacement[at] += field.displacement
        jacobian[at] += field.jacobian
    return CorrectionField(index, displacement, jacobian)
