"""The interface of a learned correction: a displacement added to the reduced positions (thesis eq. 5.1, x = x_reduced +
u).

There are two kinds. A *field correction* computes the displacement of material points as a function of the reduced
state and the collider's pose; contact then acts at the corrected points. A *contact correction* corrects the forces of
condensed contact (`runtime/contact/condensed/`), and computes the displacement of nodes from a solved contact. Both
belong to one body and one collider, are frozen, and are *bound* to the points at which they are evaluated. They are
quasi-static: they depend neither on velocity nor on history.

An *internal* correction is of a body without contact (`runtime/elasticity/displacement_field.py`).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.contact_force import FrictionForces
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


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

    def without_condensation(self) -> ContactCorrection:
        """The same on a body that another correction settles."""
        ...

    def bind(self, points: MaterialPoints, contact: CondensedContact, name: str) -> BoundContactCorrection:
        """The correction at these points, nodes of the body, prepared once. contact: solves the contacts, with the
        collider under this name."""
        ...


Correction = FieldCorrection | ContactCorrection


def mechanics_of(corrections: Iterable[Correction], otherwise: BodyMechanics | None) -> BodyMechanics | None:
    """The mechanics of a body with these corrections: those of a contact correction, which may be without static
    condensation, or have joints that settle; without one, those given."""
    of_contact = (own.mechanics for own in corrections if isinstance(own, ContactCorrection))
    return next(of_contact, otherwise)
