"""The nodes whose positions every step needs: the corners of the cubature cells and the surface samples.

Their positions are x = U rows + u(rows, poses), with u the sum of the corrections. Every correction is evaluated once
for all of these points together, since the overhead of an evaluation equals the cost of some hundred points. An
internal correction of the body is one of them, which depends on the rows alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.dynamics.timings import Phase
from softprint.runtime.elasticity.displacement_field import BoundInternal, CorrectionField, InternalField
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.correction import BoundField, FieldCorrection


class CorrectedPoints:
    """The n points of a body that every step evaluates. corners: (m, dim+1) of the cubature cells and samples: (s,) of
    the surface, both as indices of these points.

    corrections: (name of the collider, correction); reach [m]: surface samples whose reduced position is
    farther than that from the collider need no correction, see `FieldCorrection.bind`; internal: of the body, at all
    points; surface: whether the surface samples are among the points. If not, `samples` are zeros, which nobody reads.
    """

    def __init__(
        self,
        body: ReducedBody,
        corrections: Sequence[tuple[str, FieldCorrection]],
        reach: float = np.inf,
        internal: InternalField | None = None,
        surface: bool = True,
    ) -> None:
        corners = body.mesh.cells[body.cubature.cells]
        nodes = np.union1d(corners, body.surface.nodes) if surface else np.unique(corners)
        self.corners: IntArray = np.searchsorted(nodes, corners)
        self.samples: IntArray = (
            np.searchsorted(nodes, body.surface.nodes)
            if surface
            else np.zeros(len(body.surface.nodes), dtype=np.int64)
        )
        self.count = len(nodes)
        reaches = np.full(len(nodes), reach)
        reaches[self.corners] = np.inf
        points = body.node_points(nodes) if corrections else None
        self._corrections: list[tuple[str, BoundField]] = (
            []
            if points is None
            else [(name, correction.bind(points, reaches)) for name, correction in corrections]
        )
        self._internal: BoundInternal | None = None if internal is None else internal.bind(nodes)

    @property
    def without_jacobian(self) -> bool:
        """Whether `linearise` costs no more than `displacement`: an internal correction makes its Jacobian later."""
        return not self._corrections

    @property
    def by_colliders(self) -> bool:
        """Whether any correction depends on a collider."""
        return bool(self._corrections)

    @property
    def corrected(self) -> bool:
        """Whether there is any correction."""
        return bool(self._corrections) or self._internal is not None

    def displacement(self, rows: Array, poses: Poses, phase: Phase) -> Array | None:
        """u (n, dim) [m]; None without corrections."""
        if not self.corrected:
            return None
        with phase:
            fields = [bound.displacement(rows, poses[collider]) for collider, bound in self._corrections]
            if self._internal is not None:
                fields.append(self._internal.displacement(rows))
            return sum(fields[1:], start=fields[0])

    def linearise(self, rows: Array, poses: Poses, phase: Phase) -> CorrectionField | None:
        """u and du/drows of the points where any correction is active; None if there are none."""
        if not self.corrected:
            return None
        with phase:
            fields = [bound.linearise(rows, poses[collider]) for collider, bound in self._corrections]
            if self._internal is not None:
                fields.append(self._internal.linearise(rows))
            active = [field for field in fields if len(field.index)]
            return _sum_of(active) if active else None

    def scatter(self, field: CorrectionField | None) -> Array | None:
        """The field's displacement at all n points, zero where it is inactive."""
        if field is None:
            return None
        if len(field.index) == self.count:
            return field.displacement
        displacement = np.zeros((self.count, field.displacement.shape[1]))
        displacement[field.index] = field.displacement
        return displacement

    def slots(self, field: CorrectionField) -> IntArray:
        """(n,) index of each point in the field, -1 where the field is inactive."""
        slots = np.full(self.count, -1)
        slots[field.index] = np.arange(len(field.index))
        return slots


def _sum_of(fields: Sequence[CorrectionField]) -> CorrectionField:
    """The sum of several fields."""
    return fields[0] if len(fields) == 1 else SumOfFields(fields)


class SumOfFields(CorrectionField):
    """The sum of several fields, on the union of their points."""

    def __init__(self, fields: Sequence[CorrectionField]) -> None:
        index = np.unique(np.concatenate([field.index for field in fields]))
        parts = [(field, np.searchsorted(index, field.index)) for field in fields]
        self.__dict__ |= {"_parts": parts, "index": index}
        self.__dict__["displacement"] = self._sum([field.displacement for field in fields])

    _parts: Sequence[tuple[CorrectionField, IntArray]]

    @property
    def converged(self) -> bool:
        """See `CorrectionField`."""
        return all(field.converged for field, _ in self._parts)

    @lazy
    def jacobian(self) -> Array:
        """See `CorrectionField`."""
        return self._sum([field.jacobian for field, _ in self._parts])

    def along(self, directions: Array | None) -> NDArray[np.floating[Any]]:
        """See `CorrectionField`."""
        every = [field.along(directions).reshape(*field.displacement.shape, -1) for field, _ in self._parts]
        return self._sum(every).reshape(self.displacement.size, -1)

    def pulled_back(self, forces: Array) -> Array:
        """See `CorrectionField`."""
        return np.asarray(sum(field.pulled_back(forces[at]) for field, at in self._parts))

    def curvature(self, forces: Array, directions: Array | None) -> Array | None:
        """See `CorrectionField`; of the fields that know theirs."""
        every = [field.curvature(forces[at], directions) for field, at in self._parts]
        known = [own for own in every if own is not None]
        return sum(known[1:], start=known[0]) if known else None

    def _sum(self, values: Sequence[NDArray[np.floating[Any]]]) -> Array:
        """(n, ...) of values at the points of each field."""
        total = np.zeros((len(self.index), *values[0].shape[1:]))
        for own, (_, at) in zip(values, self._parts, strict=True):
            total[at] += own
        return total
