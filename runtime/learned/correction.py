"""The interface of a learned correction: a displacement added to the reduced positions (thesis eq. 5.1, x = x_reduced +
u).

There are two kinds. A *field correction* computes the displacement of material points as a function of the reduced
state and the collider's pose; contact then acts at the corrected points. A *contact correction* corrects the forces of
condensed contact (`runtime/contact/condensed/`), and computes the displacement of nodes from a solved contact. Both
belong to one body and one collider, are frozen, and are *bound* to the points at which they are evaluated. They are
quasi-static: they depend neither on velocity nor on history.

An *internal* correction is of a body without contact (thesis 4.3.1). It belongs to the body alone, and is a function of
the reduced state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.learned_energy import LearnedEnergy
from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


@dataclass(frozen=True, eq=False)
class CorrectionField:
    """A correction where it is active, linearised in the reduced state.

    index: (m,) which of the bound points; displacement: (m, dim) u [m], world frame;
    jacobian: (m, dim, n_rows, dim) du_a / d rows_rb with the collider fixed.
    """

    index: IntArray
    displacement: Array
    jacobian: Array

    def pulled_back(self, forces: Array) -> Array:
        """sum_i f_i . du_i/drows (n_rows, dim) of forces (m, dim) at its points."""
        m, dim, n_rows, _ = self.jacobian.shape
        return np.asarray((forces.ravel() @ self.jacobian.reshape(m * dim, -1)).reshape(n_rows, dim))

    def along(self, directions: Array | None) -> NDArray[np.floating[Any]]:
        """The Jacobian (m*dim, k) along directions (n_rows*dim, k) of the rows, by default every row and axis."""
        m, dim = self.displacement.shape
        jacobian = self.jacobian.reshape(m * dim, -1)
        return jacobian if directions is None else jacobian @ directions

    def curvature(self, forces: Array, directions: Array | None) -> Array | None:
        """sum_i f_i . d2u_i/drows2 (k, k) of forces (m, dim) at its points, between directions (n_rows*dim, k) of the
        rows, by default every row and axis; None where it is left out of the Hessian, as thesis 4.2.3 and 5.4 do."""
        return None

    @classmethod
    def empty(cls, dim: int, n_rows: int) -> CorrectionField:
        """A field without active points: the collider does not touch the body."""
        return cls(np.empty(0, dtype=np.int64), np.empty((0, dim)), np.empty((0, dim, n_rows, dim)))


def require_body(name: str, dim: int, n_rows: int, body: ReducedBody) -> None:
    """Raise SoftprintError where the correction `name`, for a body in dim dimensions with n_rows handle rows, is used
    with another body."""
    if (dim, n_rows) != (body.dim, body.n_rows):
        raise SoftprintError(
            f"correction {name!r} is for a {dim}D body with {n_rows} handle rows, but body "
            f"{body.name!r} is {body.dim}D with {body.n_rows}: train it for this body"
        )


class BoundField(Protocol):
    """A field correction at n fixed material points."""

    def displacement(self, rows: Array, pose: RigidPose) -> Array:
        """u (n, dim) [m] in the world frame at handle rows (n_rows, dim); zero where the correction is inactive."""
        ...

    def linearise(self, rows: Array, pose: RigidPose) -> CorrectionField:
        """u and du/drows of the active points; called once for each Newton iteration."""
        ...


class FieldCorrection(Protocol):
    """A learned displacement field. collider: name of the collider that it was trained for; beyond the signed distance
    `support` [m] from that collider it is exactly zero (inf: no such distance)."""

    name: str
    collider: str
    support: float

    def bind(self, points: MaterialPoints, reach: float | Array = np.inf) -> BoundField:
        """The correction at these points, prepared once. Points whose *reduced* position is farther than `reach` [m]
        from the collider (one number, or (n,), one per point) count as inactive: contact points need the correction
        only where they could touch."""
        ...


class BoundInternal(Protocol):
    """An internal correction at n fixed nodes."""

    def displacement(self, rows: Array) -> Array:
        """u (n, dim) [m] in the world frame at handle rows (n_rows, dim)."""
        ...

    def linearise(self, rows: Array) -> CorrectionField:
        """u and du/drows of all n nodes."""
        ...


class WeightPoint(Protocol):
    """The work of gravity along an internal correction at one state."""

    @property
    def energy(self) -> float:
        """[J]"""
        ...

    @property
    def gradient(self) -> Array:
        """By the handle rows (n_rows, dim) [N]."""
        ...

    def hessian(self, along: Array | None = None) -> Array:
        """By the handle rows, see `RowHessian`."""
        ...


class CorrectionWeight(Protocol):
    """The work of gravity along an internal correction."""

    def at(self, rows: Array) -> WeightPoint:
        """At handle rows (n_rows, dim)."""
        ...


class InternalField(Protocol):
    """An internal correction of a body. on_condensation: whether it adds to the body's static condensation, or to the
    subspace alone; gravity: (dim,) [m/s^2] under which it was learned, empty without."""

    on_condensation: bool
    gravity: tuple[float, ...]

    def bind(self, nodes: IntArray | None = None) -> BoundInternal:
        """The correction at some nodes (n,) of the body, all by default, prepared once."""
        ...

    def weight(self, mass: Array, gravity: Array) -> CorrectionWeight:
        """The work of gravity (dim,) [m/s^2] along it; mass: of every node of the body (n_nodes,) [kg]."""
        ...


class BoundContactCorrection(Protocol):
    """A contact correction at n fixed nodes."""

    def displacement(self, solved: SolvedContact, friction: FrictionForces | None = None) -> Array:
        """u (n, dim) [m] in the world frame by one collider, from a solved contact with it and possibly others; with
        what these friction forces add, of whichever collider."""
        ...


@runtime_checkable
class ContactCorrection(Protocol):
    """Learned contact forces. shape: the collider; mechanics: of the body, those used in training; law: the
    stiffness of contact, and whether it is on facets; band [m]: contact points up to this distance outside the collider
    are included; learned: the energy of contact, None for that of linear mechanics."""

    name: str
    collider: str
    shape: Collider
    mechanics: BodyMechanics
    law: PenaltyContact
    band: float
    learned: LearnedEnergy | None

    def bind(self, points: MaterialPoints, contact: CondensedContact, name: str) -> BoundContactCorrection:
        """The correction at these points, nodes of the body, prepared once. contact: solves the contacts, with the
        collider under this name."""
        ...


Correction = FieldCorrection | ContactCorrection
