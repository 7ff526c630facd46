"""W_contact of thesis eq. 5.5 at points of the body's surface, and friction, against any number of colliders.

The points are the surface samples, or on the facets between them.

With world gradients f_i and Hessians H_i of contact and friction at the points in contact x_i and J_i =
dx_i/drows,

    gradient = sum_i J_i^T f_i,    Hessian = sum_i J_i^T H_i J_i,    J_i = U_i (x) I + du_i/drows,

with u_i the corrections and static condensation; internal corrections add sum_i f_i . d2u_i/drows2. Without all of
these the Hessian is sum_i U_i U_i^T (x) H_i, one small product.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.collider_coupling import Centres, Coupling, point_coupling
from softprint.runtime.contact.contact_force import ContactForce, SurfaceForces, resultant
from softprint.runtime.contact.friction import CoulombFriction, FrictionTerms, LaggedContact
from softprint.runtime.contact.lagged_friction import LaggedFriction, SlidingFacetPoints, SlipStart
from softprint.runtime.contact.penalty import ContactTerms, PenaltyContact
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.sharp_surface import (
    SampleJacobian,
    SharpSurface,
    SharpSurfaceEvaluation,
    SharpSurfaceInFrame,
)
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.chain_rule import through_basis, through_jacobian
from softprint.runtime.linalg.means import means
from softprint.runtime.linalg.row_products import placed
from softprint.runtime.mechanics.loaded_points import LoadedPoints
from softprint.runtime.mechanics.point_condensation import CorotatedPointCondensation, PointCondensation
from softprint.runtime.mechanics.static_condensation import StaticCondensation

Terms = ContactTerms | FrictionTerms


class SurfaceContactEnergy:
    """Contact and friction of a body with its colliders, by name. Displacements and fields are those of the
    `CorrectedPoints`; x (n, dim) [m] are the positions of the contact points."""

    def __init__(
        self,
        body: ReducedBody,
        points: CorrectedPoints,
        colliders: Mapping[str, Collider],
        contact: PenaltyContact,
        friction: CoulombFriction | None,
        condensation: StaticCondensation | None = None,
    ) -> None:
        """condensation: of all nodes of the body. Without colliders nothing is evaluated at any point."""
        loaded = LoadedPoints.of_samples(body, contact.reduced_points)
        self.points, self.loaded = points, loaded if colliders else loaded.take(slice(0))
        self.samples, self.nodes = points.samples[self.loaded.nodes], body.surface.nodes
        self.material = self.loaded.material(body)
        self.basis = np.ascontiguousarray(self.material.basis)
        self.condensation = (
            None
            if condensation is None or not colliders
            else PointCondensation.at(body, condensation, self.loaded.corners, self.loaded.weights)
        )
        self.colliders, self.contact, self.friction = colliders, contact, friction
        # Where the surface has more nodes than samples, each is displaced like the nearest sample.
        nearest = cKDTree(body.mesh.points[self.nodes]).query(body.mesh.points[body.mesh.surface_nodes])[1]
        self.sharp = SharpSurface(body, colliders, contact, friction, points.samples[nearest], condensation)

    @property
    def areas(self) -> Array:
        """(n,) [m^(dim-1)] of the contact points."""
        return self.loaded.areas

    def in_frame(self, frame_rows: Array) -> SurfaceInFrame:
        """In the corotated frame of a step that starts at frame rows (n_rows, dim)."""
        condensation = None if self.condensation is None else self.condensation.corotated(frame_rows)
        return SurfaceInFrame(self, condensation, self.sharp.in_frame(frame_rows))


@dataclass(frozen=True, eq=False)
class SurfaceInFrame:
    """The contact points in the corotated frame of one step: without corrections x is affine in the handle rows."""

    term: SurfaceContactEnergy
    condensation: CorotatedPointCondensation | None
    sharp: SharpSurfaceInFrame

    def positions(self, rows: Array, displacement: Array | None) -> Array:
        """x at handle rows (n_rows, dim); displacement: u (n, dim) [m] of the corrections."""
        x = placed(self.term.basis, rows)
        if self.condensation is not None:
            x += self.condensation.displacement(rows)
        return (
            x if displacement is None else x + means(displacement, self.term.samples, self.term.loaded.shares)
        )

    def jacobian(self, index: IntArray, dim: int, field: CorrectionField | None) -> Array:
        """J (m*dim, n_rows*dim) of some of the contact points (m,)."""
        term = self.term
        jacobian: Array = np.einsum("mr,ik->mirk", term.basis[index], np.eye(dim))
        if self.condensation is not None:
            jacobian += self.condensation.jacobian(index)
        if field is not None:
            slots = term.points.slots(field)[term.samples[index]]
            for corner, share in zip(slots.T, term.loaded.shares[index].T, strict=True):
                active = np.flatnonzero(corner >= 0)
                jacobian[active] += share[active, None, None, None] * field.jacobian[corner[active]]
        return jacobian.reshape(len(index) * dim, -1)

    def felt(self, index: IntArray, forces: Array, field: CorrectionField) -> Array:
        """The forces (k, dim) at the points of a field, of forces (m, dim) at some of the contact points (m,)."""
        term, total = self.term, np.zeros((len(field.index), forces.shape[1]))
        slots = term.points.slots(field)[term.samples[index]]
        for corner, share in zip(slots.T, term.loaded.shares[index].T, strict=True):
            active = np.flatnonzero(corner >= 0)
            np.add.at(total, corner[active], share[active, None] * forces[active])
        return total

    def evaluate(
        self, x: Array, poses: Poses, rows: Array, displacement: Array | None
    ) -> SurfaceContactEvaluation:
        """Contact of points at x with the colliders at poses; rows, displacement: as for `positions`, of these x."""
        sharp = SharpSurfaceEvaluation(self.sharp, partial(self.sharp.positions, rows, displacement), poses)
        return SurfaceContactEvaluation(self, x, poses, sharp)


@dataclass(frozen=True, eq=False)
class SurfaceContactEvaluation:
    """Penalty contact at one state. lagged, in methods for friction: see `LaggedFriction`, None without friction."""

    frame: SurfaceInFrame
    x: Array
    poses: Poses
    sharp: SharpSurfaceEvaluation

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
            return self.sharp.energy + sum(contact.energy for contact in self.terms.values())
        term = self.frame.term
        return self.sharp.energy + sum(
            term.contact.energy(self.x, term.areas, collider, self.poses[name])
            for name, collider in term.colliders.items()
        )

    def lag(self, start: SlipStart) -> tuple[dict[str, LaggedContact], dict[str, SlidingFacetPoints]]:
        """The lagged contact with each collider: of the contact points, and of its sharp points."""
        law = self.frame.term.friction
        if law is None:
            return {}, {}
        own = {
            name: law.lag(contact, start.surface, start.poses[name], self.poses[name])
            for name, contact in self.terms.items()
        }
        return own, self.sharp.lag(start)

    def friction(self, lagged: LaggedFriction | None) -> dict[str, FrictionTerms]:
        """Friction of the contact points with each collider."""
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
        own = sum(terms.energy for terms in self.friction(lagged).values())
        return own + self.sharp.friction_energy(lagged)

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
        slots = (
            SampleJacobian(self.frame.term.points.slots(field), field.jacobian)
            if field is not None and self.frame.term.sharp.contacts
            else None
        )
        by_rows, by_sharp, couplings = self.sharp.linearise(slots, lagged, centres, n_rows)
        if not len(index):
            return by_rows, by_sharp, couplings
        couplings += [
            self._coupling(name, by_collider[name], field, centre)
            for name, centre in centres.items()
            if any(len(term.index) for term in by_collider.get(name, ()))
        ]
        if field is None and self.frame.condensation is None:
            slope, curvature = through_basis(self.frame.term.basis[index], gradient, hessian)
        else:
            slope, curvature = through_jacobian(self.frame.jacobian(index, dim, field), gradient, hessian)
            bent = None if field is None else field.curvature(self.frame.felt(index, gradient, field), None)
            curvature = curvature if bent is None else curvature + bent
        return by_rows + slope, curvature if by_sharp is None else curvature + by_sharp, couplings

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
        friction, sharp, forces = self.friction(lagged), self.sharp.forces(lagged), {}
        for name, contact in self.terms.items():
            parts = [self._surface_forces(contact, tangential=False)]
            if name in friction:
                parts.append(self._surface_forces(friction[name], tangential=True))
            depth, count = float(contact.depth.max(initial=0.0)), len(contact.index)
            if name in sharp:
                own, deepest = sharp[name]
                parts += own
                depth, count = max(depth, deepest), count + len(self.sharp.terms[name].points)
            total = resultant(parts, self.poses[name].translation)
            forces[name] = ContactForce(*total, depth, count, parts)
        return forces

    def _surface_forces(self, terms: Terms, tangential: bool) -> SurfaceForces:
        term, index = self.frame.term, terms.index
        nodes, forces = term.loaded.felt(index, terms.gradient)
        places = np.repeat(self.x[index], term.loaded.nodes.shape[1], axis=0)
        return SurfaceForces(term.nodes, nodes, places, forces, tangential)


def _summed(terms: Sequence[Terms], dim: int) -> tuple[IntArray, Array, Array]:
    """The sum of several terms at the points in contact: index (m,), gradient (m, dim), Hessian (m, dim, dim)."""
    index = np.unique(np.concatenate([term.index for term in terms] or [np.empty(0, dtype=np.int64)]))
    gradient, hessian = np.zeros((len(index), dim)), np.zeros((len(index), dim, dim))
    for term in terms:
        at = np.searchsorted(index, term.index)
        gradient[at] += term.gradient
        hessian[at] += term.hessian
    return index, gradient, hessian
