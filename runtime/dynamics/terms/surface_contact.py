"""W_contact of thesis eq. 5.5 at the body's surface samples, and friction, against any number of colliders.

With world gradients f_i and Hessians H_i of contact and friction at the touching points x_i and J_i =
dx_i/drows,

    gradient = sum_i J_i^T f_i,    Hessian = sum_i J_i^T H_i J_i,    J_i = U_i (x) I + du_i/drows,

u_i being the corrections and the internal response. Where there is neither the Hessian is the
Kronecker-shaped sum_i U_i U_i^T (x) H_i: one small product.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.colliders.pose import Poses
from runtime.contact import ContactTerms, CoulombFriction, FrictionTerms, PenaltyContact
from runtime.contact.collider_coupling import Centres, Coupling, point_coupling
from runtime.contact.contact_force import ContactForce, SurfaceForces, resultant
from runtime.contact.friction_state import FrictionState
from runtime.dynamics.corrected_points import CorrectedPoints
from runtime.learned.correction import CorrectionField
from runtime.linalg.chain_rule import through_basis, through_jacobian
from runtime.linalg.row_products import placed
from runtime.mechanics.static_condensation import StaticCondensation


class SurfaceContactEnergy:
    """Contact and friction of a body with its colliders, by name; displacements and fields are those of the
    watched points, x (s, dim) [m] are positions of the surface samples, none where there is no collider."""

    def __init__(
        self,
        body: ReducedBody,
        points: CorrectedPoints,
        colliders: dict[str, Collider],
        contact: PenaltyContact,
        friction: CoulombFriction | None,
        internal: StaticCondensation | None = None,
    ) -> None:
        """internal: of all nodes of the body."""
        samples = slice(None) if colliders else slice(0)
        nodes = body.surface.nodes[samples]
        self._points, self._samples = points, points.samples[samples]
        self._nodes = nodes
        self._basis = np.ascontiguousarray(body.basis[nodes])
        self._internal = None if internal is None or not colliders else internal.at(nodes)
        self._areas = body.surface.areas[samples]
        self._colliders = colliders
        self._contact = contact
        self._friction = friction

    def positions(self, rows: Array, turn: Array, displacement: Array | None) -> Array:
        """x; turn: of the internal response; displacement: u (n, dim) [m] of the corrections."""
        x = placed(self._basis, rows)
        if self._internal is not None:
            x += self._internal.displacement(rows, turn)
        return x if displacement is None else x + displacement[self._samples]

    def energy(self, x: Array, poses: Poses, step: FrictionState | None) -> float:
        """Contact and (lagged) friction energy [J]; none of friction before it was lagged."""
        total = 0.0
        for name, collider in self._colliders.items():
            total += self._contact.energy(x, self._areas, collider, poses[name])
            if self._friction is not None and step is not None and name in step.lagged:
                total += self._friction.terms(x, step.lagged[name].at(poses[name]), step.time_step).energy
        return total

    def linearise(
        self,
        x: Array,
        turn: Array,
        field: CorrectionField | None,
        poses: Poses,
        step: FrictionState | None,
        relag: bool,
        centres: Centres = MappingProxyType({}),
    ) -> tuple[float, Array, Array | None, list[Coupling]]:
        """Energy [J], gradient (n_rows, dim) [N] and Hessian (n_rows*dim, n_rows*dim) [N/m] by the rows, no
        Hessian where nothing touches; and what the colliders feel that move freely about their centres. ``relag``: let
        friction take up the normal forces found here."""
        if not self._colliders:
            return 0.0, np.zeros((self._basis.shape[1], x.shape[1])), None, []
        terms = {name: self._terms(name, x, poses, step, relag) for name in self._colliders}
        everything = [term for of_one in terms.values() for term in of_one]
        energy = sum(term.energy for term in everything)
        index, gradient, hessian = _summed(everything, x.shape[1])
        if not len(index):
            return energy, np.zeros((self._basis.shape[1], x.shape[1])), None, []
        couplings = [
            self._coupling(name, terms[name], x, turn, field, centre)
            for name, centre in centres.items()
            if any(len(term.index) for term in terms.get(name, ()))
        ]
        if field is None and self._internal is None:
            by_rows = through_basis(self._basis[index], gradient, hessian)
        else:
            by_rows = through_jacobian(self._jacobian(index, turn, field), gradient, hessian)
        return energy, *by_rows, couplings

    def _terms(
        self, name: str, x: Array, poses: Poses, step: FrictionState | None, relag: bool
    ) -> list[ContactTerms | FrictionTerms]:
        """Contact and friction with one collider."""
        contact = self._contact.terms(x, self._areas, self._colliders[name], poses[name])
        if self._friction is None or step is None:
            return [contact]
        if relag:
            step.lagged[name] = self._friction.lag(contact, step.surface, step.poses[name], poses[name])
        return [contact, self._friction.terms(x, step.lagged[name].at(poses[name]), step.time_step)]

    def _coupling(
        self,
        name: str,
        terms: Sequence[ContactTerms | FrictionTerms],
        x: Array,
        turn: Array,
        field: CorrectionField | None,
        centre: Array,
    ) -> Coupling:
        """What one collider feels."""
        index, gradient, hessian = _summed(terms, x.shape[1])
        motion = self._jacobian(index, turn, field).reshape(*gradient.shape, -1)
        return point_coupling(name, x[index] - centre, gradient, hessian, motion)

    def _jacobian(self, index: IntArray, turn: Array, field: CorrectionField | None) -> Array:
        """J (m*dim, n_rows*dim) of the surface samples ``index``."""
        dim = turn.shape[1]
        jacobian: Array = np.einsum("mr,ik->mirk", self._basis[index], np.eye(dim))
        if self._internal is not None:
            jacobian += self._internal.derivative(turn, index)
        if field is not None:
            slots = self._points.slots(field)[self._samples[index]]
            active = np.flatnonzero(slots >= 0)
            jacobian[active] += field.jacobian[slots[active]]
        return jacobian.reshape(len(index) * dim, -1)

    def forces(
        self, x: Array, poses: Poses, step: FrictionState | None
    ) -> tuple[float, float, dict[str, ContactForce]]:
        """Contact energy, friction energy [J] and the force on each collider, with the surface samples at
        x."""
        normal_energy, friction_energy = 0.0, 0.0
        forces = {}
        for name, collider in self._colliders.items():
            contact = self._contact.terms(x, self._areas, collider, poses[name])
            normal_energy += contact.energy
            index = contact.index
            loads = [SurfaceForces(self._nodes, index, x[index], contact.gradient)]
            if self._friction is not None and step is not None:
                friction = self._friction.terms(x, step.lagged[name].at(poses[name]), step.time_step)
                friction_energy += friction.energy
                index = friction.index
                loads.append(SurfaceForces(self._nodes, index, x[index], friction.gradient, tangential=True))
            force, torque = resultant(loads, poses[name].translation)
            forces[name] = ContactForce(
                force, torque, float(contact.depth.max(initial=0.0)), len(contact.index), loads
            )
        return normal_energy, friction_energy, forces


def _summed(terms: Sequence[ContactTerms | FrictionTerms], dim: int) -> tuple[IntArray, Array, Array]:
    """Of the points that touch anything: index (m,), gradient (m, dim), Hessian (m, dim, dim)."""
    index = np.unique(np.concatenate([term.index for term in terms] or [np.empty(0, dtype=np.int64)]))
    gradient, hessian = np.zeros((len(index), dim)), np.zeros((len(index), dim, dim))
    for term in terms:
        at = np.searchsorted(index, term.index)
        gradient[at] += term.gradient
        hessian[at] += term.hessian
    return index, gradient, hessian
