"""W_contact of thesis eq. 5.5 at the body's surface samples, and friction, against any number of colliders.

With world gradients f_i and Hessians H_i of contact and friction at the points in contact x_i and J_i =
dx_i/drows,

    gradient = sum_i J_i^T f_i,    Hessian = sum_i J_i^T H_i J_i,    J_i = U_i (x) I + du_i/drows,

with u_i the corrections and static condensation. Without both, the Hessian is sum_i U_i U_i^T (x) H_i, one small
product.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.collider_coupling import Centres, Coupling, point_coupling
from softprint.runtime.contact.contact_force import ContactForce, SurfaceForces, resultant
from softprint.runtime.contact.friction import CoulombFriction, FrictionTerms, LaggedContact
from softprint.runtime.contact.lagged_friction import LaggedFriction, SlipStart
from softprint.runtime.contact.penalty import ContactTerms, PenaltyContact
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.correction import CorrectionField
from softprint.runtime.linalg.chain_rule import through_basis, through_jacobian
from softprint.runtime.linalg.row_products import placed
from softprint.runtime.mechanics.static_condensation import CorotatedCondensation, StaticCondensation

Terms = ContactTerms | FrictionTerms


class SurfaceContactEnergy:
    """Contact and friction of a body with its colliders, by name. Displacements and fields are those of the
    `CorrectedPoints`; x (s, dim) [m] are the positions of the surface samples, none without colliders."""

    def __init__(
        self,
        body: ReducedBody,
        points: CorrectedPoints,
        colliders: Mapping[str, Collider],
        contact: PenaltyContact,
        friction: CoulombFriction | None,
        condensation: StaticCondensation | None = None,
    ) -> None:
        """condensation: of the surface samples."""
        samples = slice(None) if colliders else slice(0)
        self.points, self.samples = points, points.samples[samples]
        self.nodes = body.surface.nodes[samples]
        self.basis = np.ascontiguousarray(body.basis[self.nodes])
        self.condensation = condensation if colliders else None
        self.areas = body.surface.areas[samples]
        self.colliders, self.contact, self.friction = colliders, contact, friction

    def in_frame(self, frame_rows: Array) -> SurfaceInFrame:
        """In the corotated frame of a step that starts at frame rows (n_rows, dim)."""
        condensation = None if self.condensation is None else self.condensation.corotated(frame_rows)
        return SurfaceInFrame(self, condensation)


@dataclass(frozen=True, eq=False)
class SurfaceInFrame:
    """The surface samples in the corotated frame of one step: without corrections x is affine in the handle rows."""

    term: SurfaceContactEnergy
    condensation: CorotatedCondensation | None

    def positions(self, rows: Array, displacement: Array | None) -> Array:
        """x at handle rows (n_rows, dim); displacement: u (n, dim) [m] of the corrections."""
        x = placed(self.term.basis, rows)
        if self.condensation is not None:
            x += self.condensation.displacement(rows)
        return x if displacement is None else x + displacement[self.term.samples]

    def jacobian(self, index: IntArray, dim: int, field: CorrectionField | None) -> Array:
        """J (m*dim, n_rows*dim) of some of the surface samples (m,)."""
        term = self.term
        jacobian: Array = np.einsum("mr,ik->mirk", term.basis[index], np.eye(dim))
        if self.condensation is not None:
            jacobian += self.condensation.jacobian(index)
        if field is not None:
            slots = term.points.slots(field)[term.samples[index]]
            active = np.flatnonzero(slots >= 0)
            jacobian[active] += field.jacobian[slots[active]]
        return jacobian.reshape(len(index) * dim, -1)

    def evaluate(self, x: Array, poses: Poses) -> SurfaceContactEvaluation:
        """Contact of samples at x with the colliders at poses."""
        return SurfaceContactEvaluation(self, x, poses)


@dataclass(frozen=True, eq=False)
class SurfaceContactEvaluation:
    """Penalty contact at one state. lagged, in methods for friction: see `LaggedFriction`, None without friction."""

    frame: SurfaceInFrame
    x: Array
    poses: Poses

    @lazy
    def terms(self) -> dict[str, ContactTerms]:
        """Contact with each collider."""
        term = self.frame.term
        return {
            name: term.contact.terms(self.x, term.areas, collider, self.poses[name])
            for name, collider in term.colliders.items()
        }

    @lazy
    def energy(self) -> float:
        """Contact energy [J]; computed without derivatives where these have not been computed."""
        if "terms" in self.__dict__:
            return sum(contact.energy for contact in self.terms.values())
        term = self.frame.term
        return sum(
            term.contact.energy(self.x, term.areas, collider, self.poses[name])
            for name, collider in term.colliders.items()
        )

    def lag(self, start: SlipStart) -> dict[str, LaggedContact]:
        """The lagged contact with each collider."""
        law = self.frame.term.friction
        if law is None:
            return {}
        return {
            name: law.lag(contact, start.surface, start.poses[name], self.poses[name])
            for name, contact in self.terms.items()
        }

    def friction(self, lagged: LaggedFriction | None) -> dict[str, FrictionTerms]:
        """Friction with each collider."""
        law = self.frame.term.friction
        if law is None or lagged is None:
            return {}
        h = lagged.start.time_step
        return {
            name: law.terms(self.x, contact.at(self.poses[name]), h)
            for name, contact in lagged.surface.items()
        }

    def friction_energy(self, lagged: LaggedFriction | None) -> float:
        """Friction energy [J]."""
        return sum(terms.energy for terms in self.friction(lagged).values())

    def linearise(
        self,
        field: CorrectionField | None,
        lagged: LaggedFriction | None,
        centres: Centres,
        n_rows: int,
    ) -> tuple[Array, Array | None, list[Coupling]]:
        """Gradient (n_rows, dim) [N] and Hessian (n_rows*dim, n_rows*dim) [N/m] of contact and friction by the rows, no
        Hessian without contact; and the couplings with the colliders that move freely, about their centres."""
        dim, friction = self.x.shape[1], self.friction(lagged)
        by_collider: dict[str, list[Terms]] = {
            name: [contact, *([friction[name]] if name in friction else [])]
            for name, contact in self.terms.items()
        }
        index, gradient, hessian = _summed([term for terms in by_collider.values() for term in terms], dim)
        if not len(index):
            return np.zeros((n_rows, dim)), None, []
        couplings = [
            self._coupling(name, by_collider[name], field, centre)
            for name, centre in centres.items()
            if any(len(term.index) for term in by_collider.get(name, ()))
        ]
        if field is None and self.frame.condensation is None:
            by_rows = through_basis(self.frame.term.basis[index], gradient, hessian)
        else:
            by_rows = through_jacobian(self.frame.jacobian(index, dim, field), gradient, hessian)
        return *by_rows, couplings

    def _coupling(
        self, name: str, terms: Sequence[Terms], field: CorrectionField | None, centre: Array
    ) -> Coupling:
        """The coupling with one collider."""
        dim = self.x.shape[1]
        index, gradient, hessian = _summed(terms, dim)
        jacobian = self.frame.jacobian(index, dim, field).reshape(*gradient.shape, -1)
        return point_coupling(name, self.x[index] - centre, gradient, hessian, jacobian)

    def forces(self, lagged: LaggedFriction | None) -> dict[str, ContactForce]:
        """The force on each collider."""
        nodes, friction = self.frame.term.nodes, self.friction(lagged)
        forces = {}
        for name, contact in self.terms.items():
            index = contact.index
            parts = [SurfaceForces(nodes, index, self.x[index], contact.gradient)]
            if name in friction:
                index, tangential = friction[name].index, friction[name].gradient
                parts.append(SurfaceForces(nodes, index, self.x[index], tangential, tangential=True))
            total = resultant(parts, self.poses[name].translation)
            depth = float(contact.depth.max(initial=0.0))
            forces[name] = ContactForce(*total, depth, len(contact.index), parts)
        return forces


def _summed(terms: Sequence[Terms], dim: int) -> tuple[IntArray, Array, Array]:
    """The sum of several terms at the points in contact: index (m,), gradient (m, dim), Hessian (m, dim, dim)."""
    index = np.unique(np.concatenate([term.index for term in terms] or [np.empty(0, dtype=np.int64)]))
    gradient, hessian = np.zeros((len(index), dim)), np.zeros((len(index), dim, dim))
    for term in terms:
        at = np.searchsorted(index, term.index)
        gradient[at] += term.gradient
        hessian[at] += term.hessian
    return index, gradient, hessian
