"""Friction of condensed contact, at its active points.

An active point sits at x(q) + A(q) (v + u), with v its displacement by frictionless contact and u that by friction, in
rest coordinates. Lagged Coulomb friction (`runtime/contact/friction.py`) fixes the normal forces p |g| and the
normals g / |g| of the last contact solve, and v. Friction and the compliance of the surface in series
(`compliant_friction.py`) are then an ordinary potential of the handle rows q,

    D(q) = min_u  sum_j mu N_j f0(|P_j d_j|) + 1/2 u . G^-1 u,
    d_j  = x_j + A_j (v_j + u_j) - T_end T_start^-1 x_j,start.

x_start are the positions of the same points at the start of the step, with the displacements of that state by contact
and by friction: a dent that travels over the body slips as far as its points do. For this a state stores the friction
forces on its contact nodes. Pressure is that on the surface as the last friction has displaced it
(`runtime/contact/solver/given_displacement.py`), of all colliders. What the friction of one collider does to the slip
of points that touch another is neglected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.contact.collider_coupling import Centres, Coupling
from softprint.runtime.contact.condensed.compliant_friction import (
    CompliantFriction,
    CompliantPoints,
    settle,
)
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.contact_force import ContactForce, FrictionForces, resultant
from softprint.runtime.contact.friction import CoulombFriction, LaggedContact
from softprint.runtime.contact.lagged_friction import SlidingMotion, SlidingPoints, SlipStart
from softprint.runtime.contact.solver.contact_solve_kernels import to_world
from softprint.runtime.rigid.twist import touched_body_derivatives


@dataclass(frozen=True, eq=False)
class CondensedFriction:
    """The friction of a body with the colliders of its condensed contact."""

    law: CoulombFriction

    def lag(
        self, contact: ContactEvaluation, poses: Poses, start: SlipStart, last: FrictionForces | None = None
    ) -> dict[str, SlidingPoints]:
        """Fix the active points of a contact by collider, with the colliders at their poses at the end of the step.
        last: friction that is near, from which that here settles; None for zero."""
        return {name: self._lagged(name, contact, poses[name], start, last) for name in contact.colliders}

    def _lagged(
        self,
        name: str,
        contact: ContactEvaluation,
        pose: RigidPose,
        start: SlipStart,
        last: FrictionForces | None,
    ) -> SlidingPoints:
        active = contact.active_points(name)
        length = np.linalg.norm(active.normal, axis=1)
        normal = active.normal / np.where(length > 0.0, length, 1.0)[:, None]
        before = start.contact_points(active.index, contact)
        lagged = LaggedContact(
            index=np.arange(len(active.index)),
            force=np.maximum(active.pressure, 0.0) * length,
            normal=normal,
            anchor=pose.apply(start.poses[name].apply_inverse(before)),
            pose=pose,
        )
        surface, every = active.surface(), contact.every
        carrier, given = every.carriers(contact.rows, active.index), every.given_displacement(active.index)
        compliance = CompliantPoints.of(surface.compliance, normal.shape[1])
        sliding = SlidingPoints(
            lagged,
            active.index,
            contact,
            surface,
            active.position - to_world(carrier, surface.displacement + given),
            compliance,
            None if last is None else compliance.displaced_by(_at_nodes(last, contact, active.index)),
        )
        return replace(sliding, start=self.settled(sliding, contact.rows, pose, start.time_step).displacement)

    def settled(
        self, sliding: SlidingPoints, rows: Array, pose: RigidPose, time_step: float
    ) -> CompliantFriction:
        """Friction with one collider at a pose, at handle rows (n_rows, dim)."""
        lagged = sliding.lagged.at(pose)
        return settle(
            lambda x: self.law.terms(x, lagged, time_step),
            sliding.positions(rows),
            sliding.carriers(rows),
            sliding.compliance,
            sliding.start,
        )

    def evaluate(
        self, sliding: Mapping[str, SlidingPoints], rows: Array, poses: Poses, time_step: float
    ) -> CondensedFrictionEvaluation:
        """Friction with all colliders at their poses, at handle rows (n_rows, dim)."""
        settled = {name: self.settled(own, rows, poses[name], time_step) for name, own in sliding.items()}
        return CondensedFrictionEvaluation(sliding, rows, poses, settled)


@dataclass(frozen=True, eq=False)
class CondensedFrictionEvaluation:
    """Lagged friction at handle rows (n_rows, dim) and poses: settled, by collider."""

    sliding: Mapping[str, SlidingPoints]
    rows: Array
    poses: Poses
    settled: Mapping[str, CompliantFriction]

    @property
    def energy(self) -> float:
        """D [J] of all colliders."""
        return sum(found.energy for found in self.settled.values())

    @property
    def converged(self) -> bool:
        """Whether friction balances everywhere."""
        return all(found.converged for found in self.settled.values())

    def linearise(self, centres: Centres) -> tuple[Array, Array | None, list[Coupling]]:
        """dD/drows (n_rows, dim) [N], its Hessian (n_rows*dim, n_rows*dim) [N/m], None where no point slides, and the
        couplings of the colliders that move freely, about their centres."""
        gradient, hessian, couplings = np.zeros_like(self.rows), None, []
        for name, own in self._touched.items():
            found = self.settled[name]
            moved = own.moved(self.rows, found.rest_displacement)
            slope, curvature = found.through(moved.jacobian, moved.carriers)
            curvature = curvature + moved.bending(found.terms.gradient)
            gradient, hessian = gradient + slope, curvature if hessian is None else hessian + curvature
            if name in centres:
                couplings.append(_coupling(name, centres[name], found, moved))
        return gradient, hessian, couplings

    def added_to(self, forces: Mapping[str, ContactForce]) -> dict[str, ContactForce]:
        """The forces of a contact on the colliders with friction added."""
        result = {}
        for name, force in forces.items():
            own, found = self.sliding[name], self.settled[name]
            friction = own.contact.surface_forces(
                own.index, found.position, found.terms.gradient, tangential=True
            )
            parts = [*force.parts, friction]
            total = resultant(parts, self.poses[name].translation)
            result[name] = ContactForce(*total, force.penetration, force.points, parts)
        return result

    @property
    def node_forces(self) -> FrictionForces | None:
        """The friction forces on the body of all colliders together; None where nothing touches."""
        touched = self._touched
        if not touched:
            return None
        contact = next(iter(touched.values())).contact.contact
        assert contact is not None  # it has active points
        index = np.concatenate([own.index for own in touched.values()])
        loads = [self.settled[name].rest_forces for name in touched]
        order = np.argsort(index)
        on_nodes = contact.start.compliance.on_nodes(index[order], np.concatenate(loads)[order])
        return FrictionForces(*on_nodes)

    @property
    def _touched(self) -> dict[str, SlidingPoints]:
        """The colliders that points slide on."""
        return {name: own for name, own in self.sliding.items() if len(own.index)}


def _at_nodes(friction: FrictionForces, contact: ContactEvaluation, points: IntArray) -> Array:
    """Its forces (k, dim) [N] on the contact nodes (k,) that forces on some of the contact points (m,) act on."""
    nodes = contact.loaded.among(points)[0]
    _, here, there = np.intersect1d(nodes, friction.nodes, assume_unique=True, return_indices=True)
    forces = np.zeros((len(nodes), friction.forces.shape[1]))
    forces[here] = friction.forces[there]
    return forces


def _coupling(name: str, centre: Array, found: CompliantFriction, moved: SlidingMotion) -> Coupling:
    """The coupling with one collider that moves freely about its centre (dim,) [m]. moved: of the points."""
    arms = found.position - centre
    slope, mixed, own = touched_body_derivatives(arms, found.terms.gradient, found.terms.hessian)
    return Coupling(name, slope, lambda: found.by_twist(mixed, own, moved.jacobian, moved.carriers))
