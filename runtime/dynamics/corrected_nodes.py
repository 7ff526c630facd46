"""Positions of nodes of a body at a state, with all corrections: for drawing and evaluation, not for dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.drawn_contact import DrawnContact
from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.elasticity.displacement_field import BoundInternal, InternalField
from softprint.runtime.learned.correction import (
    BoundContactCorrection,
    BoundField,
    ContactCorrection,
    FieldCorrection,
)
from softprint.runtime.linalg.row_products import placed
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance
from softprint.runtime.mechanics.static_condensation import StaticCondensation


class Snapshot(NamedTuple):
    """The data from which positions are computed: handle rows and frame rows (n_rows, dim) of a state, its solved
    contact, and the friction there; displacements (n, dim) [m] by field and internal corrections, None without one."""

    rows: Array
    frame_rows: Array
    contact: SolvedContact | None
    friction: FrictionForces | None
    field: Array | None


class Corrections(NamedTuple):
    """The corrections of a scene: field corrections and contact corrections by the names of their colliders; contact:
    solves condensed contact, None without condensed contact; compliance: of the body, likewise; internal: of the body,
    None without one."""

    fields: Mapping[str, FieldCorrection]
    of_contact: Mapping[str, ContactCorrection]
    contact: CondensedContact | None
    compliance: SurfaceCompliance | None = None
    internal: InternalField | None = None


class CorrectedNodes:
    """x = U rows + static condensation + corrections of the given nodes, all by default. condensation: of these nodes.
    Everything is prepared at its first use."""

    def __init__(
        self,
        body: ReducedBody,
        corrections: Corrections,
        condensation: StaticCondensation | None,
        nodes: IntArray | None = None,
    ) -> None:
        self._body, self._corrections, self._nodes = body, corrections, nodes
        self._condensation = condensation

    def field_displacement(self, rows: Array, poses: Mapping[str, RigidPose]) -> Array | None:
        """u (n, dim) [m] by field and internal corrections; None without one."""
        found = [bound.displacement(rows, poses[name]) for name, bound in self._fields]
        if self._internal is not None:
            found.append(self._internal.displacement(rows))
        return sum(found[1:], start=found[0]) if found else None

    def positions(self, snapshot: Snapshot) -> Array:
        """(n, dim) [m] of a snapshot of these nodes. May run on any thread or in another process, concurrently with
        steps."""
        x = placed(self._basis, snapshot.rows)
        if self._condensation is not None:
            x += self._condensation.corotated(snapshot.frame_rows).displacement(snapshot.rows)
        if snapshot.field is not None:
            x += snapshot.field
        if snapshot.contact is not None:
            for number, bound in enumerate(self._of_contact):
                x += bound.displacement(snapshot.contact, None if number else snapshot.friction)
        return x

    @cached_property
    def _basis(self) -> Array:
        return self._body.basis if self._nodes is None else self._body.basis[self._nodes]

    @cached_property
    def _fields(self) -> Sequence[tuple[str, BoundField]]:
        fields = self._corrections.fields
        if not fields:
            return []
        points = self._body.node_points(self._nodes)
        return [(name, field.bind(points)) for name, field in fields.items()]

    @cached_property
    def _internal(self) -> BoundInternal | None:
        internal = self._corrections.internal
        return None if internal is None else internal.bind(self._nodes)

    @cached_property
    def _of_contact(self) -> Sequence[BoundContactCorrection]:
        corrections, contact = self._corrections.of_contact, self._corrections.contact
        compliance = self._corrections.compliance
        if contact is None or compliance is None:
            return []
        points = self._body.node_points(self._nodes)
        bound = [correction.bind(points, contact, name) for name, correction in corrections.items()]
        others = [name for name in contact.searches if name not in corrections]
        if others:
            nodes = np.arange(self._body.n_nodes) if self._nodes is None else self._nodes
            bound.append(DrawnContact(points, nodes, compliance, contact, others))
        return bound
