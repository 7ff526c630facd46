"""Friction of condensed contact, at its active points.

An active point sits at y(q) = x(q) + F(q) v, v being its contact displacement in rest coordinates. Lagged Coulomb
friction (`runtime/contact/friction.py`) fixes not only the normal forces p |g| and the normals g / |g| of the last
contact solve, but v too, so that y is affine in the handle rows q and

    D(q) = sum_j mu N_j f0(|P_j u_j|),    u_j = y_j(q) - T_end T_start^-1 y_j,start,
    dD   = sum_j f_j . dy_j,              dy = dx + dF v,

is an ordinary friction potential of the rows. y_start are the positions of the same points at the start of the step,
with the contact displacement of that state: a dent that travels over the body slips as far as its points do.

The contact displacement itself is that of frictionless contact. The displacement by tangential tractions is neglected,
since a state would have to store it as history. So where the contact sticks, only the subspace follows the collider
sideways, and the response is too stiff: dragging a ball of 3 cm over a block of 10 cm, the tangential stiffness is 1.3
(2D) to 1.8 (3D) times that in full space. Once it slips, the force along the path is right to 3 % at mu = 0.3, and 2 %
(2D) to 15 % (3D) too small at mu = 1. Over the held-out motion of the small Jelly at mu = 0.3 the error of the force on
the collider is 23 % (RMS); without friction it is 51 %, on the subspace alone 146 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.contact.collider_coupling import Centres, Coupling, point_coupling
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.contact_force import ContactForce, resultant
from softprint.runtime.contact.friction import CoulombFriction, FrictionTerms, LaggedContact
from softprint.runtime.contact.lagged_friction import SlidingPoints, SlipStart
from softprint.runtime.linalg.chain_rule import through_jacobian


@dataclass(frozen=True, eq=False)
class CondensedFriction:
    """The friction of a body with the colliders of its condensed contact."""

    law: CoulombFriction

    def lag(self, contact: ContactEvaluation, poses: Poses, start: SlipStart) -> dict[str, SlidingPoints]:
        """Fix the active points of a contact by collider, with the colliders at their poses at the end of the step."""
        return {name: self._lagged(name, contact, poses[name], start) for name in contact.colliders}

    def _lagged(
        self, name: str, contact: ContactEvaluation, pose: RigidPose, start: SlipStart
    ) -> SlidingPoints:
        active = contact.active_points(name)
        length = np.linalg.norm(active.normal, axis=1)
        before = start.contact_points(active.index, contact)
        lagged = LaggedContact(
            index=np.arange(len(active.index)),
            force=active.pressure * length,
            normal=active.normal / np.where(length > 0.0, length, 1.0)[:, None],
            anchor=pose.apply(start.poses[name].apply_inverse(before)),
            pose=pose,
        )
        return SlidingPoints(lagged, active.index, contact, active.position, active.jacobian())

    def terms(self, sliding: SlidingPoints, rows: Array, pose: RigidPose, time_step: float) -> FrictionTerms:
        """Friction with one collider at a pose, at handle rows (n_rows, dim)."""
        return self.law.terms(sliding.positions(rows), sliding.lagged.at(pose), time_step)

    def energy(
        self, sliding: Mapping[str, SlidingPoints], rows: Array, poses: Poses, time_step: float
    ) -> float:
        """D [J] of all colliders."""
        return sum(self.terms(own, rows, poses[name], time_step).energy for name, own in sliding.items())

    def linearise(
        self,
        sliding: Mapping[str, SlidingPoints],
        rows: Array,
        poses: Poses,
        centres: Centres,
        time_step: float,
    ) -> tuple[Array, Array | None, list[Coupling]]:
        """dD/drows (n_rows, dim) [N], its Hessian (n_rows*dim, n_rows*dim) [N/m], None where no point slides, and the
        couplings of the colliders that move freely, about their centres."""
        gradient, hessian, couplings = np.zeros_like(rows), None, []
        for name, own in sliding.items():
            terms = self.terms(own, rows, poses[name], time_step)
            if not len(terms.index):
                continue
            jacobian = own.jacobian.reshape(terms.gradient.size, -1)
            slope, curvature = through_jacobian(jacobian, terms.gradient, terms.hessian)
            gradient, hessian = gradient + slope, curvature if hessian is None else hessian + curvature
            if name in centres:
                arms = own.positions(rows) - centres[name]
                couplings.append(point_coupling(name, arms, terms.gradient, terms.hessian, own.jacobian))
        return gradient, hessian, couplings

    def with_friction(
        self,
        forces: Mapping[str, ContactForce],
        sliding: Mapping[str, SlidingPoints],
        contact: ContactEvaluation,
        poses: Poses,
        time_step: float,
    ) -> dict[str, ContactForce]:
        """The forces of a contact on the colliders with friction added."""
        result, rows = {}, contact.rows
        for name, force in forces.items():
            own = sliding[name]
            terms = self.terms(own, rows, poses[name], time_step)
            at = own.positions(rows)
            friction = own.contact.surface_forces(own.index, at, terms.gradient, tangential=True)
            parts = [*force.parts, friction]
            total = resultant(parts, poses[name].translation)
            result[name] = ContactForce(*total, force.penetration, force.points, parts)
        return result
