"""The inputs of the force model: the contact points near the collider, and the forces on them by linear mechanics.

All points within a band around the collider are included, not only the active set, so that learned forces can act where
linear mechanics has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.elasticity.invariants import cofactor
from softprint.runtime.learned.deformed_normal import SHORTEST
from softprint.runtime.learned.force.inputs import RANGE, contact_inputs, inputs_around
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


@dataclass(frozen=True, eq=False)
class ContactState:
    """index: (m,) contact points; force: l (m, dim) [N] by linear mechanics, in rest coordinates; inputs: a (m,
    n_contact_inputs(dim)), see `inputs.py`; lever: w R^T v_k (m, DIRECTIONS, dim) [m^(dim-1)] with the directions v =
    g, N and u / band of `inputs.py` and w = area x^2 / (1 + x^2), x = 1 - distance / band, C1 and zero at the edge of
    the band; depth: D [m], see `patch_depth`. Rotating body and collider together changes none of these. pressed: the
    contact nodes (k,) that sharp points of the collider press, and these forces (k, dim) [N], in rest coordinates,
    which stay those of linear mechanics; None without."""

    index: IntArray
    force: Array
    inputs: Array
    lever: Array
    depth: float
    pressed: tuple[IntArray, Array] | None = None


def patch_depth(areas: Array, distance: Array) -> float:
    """The depth of the whole contact D [m] = sum a d^3 / sum a d^2, with d the depths of points without contact
    displacement at signed distances (m,). Points enter and leave it smoothly. 0 where no point is inside."""
    d = np.maximum(-distance, 0.0)
    return float(areas @ d**3 / (areas @ d**2)) if d.any() else 0.0


class ContactMeasurement:
    """Measures `ContactState`s of one body and one collider. contact: solves the contacts, with the collider under this
    name; band: [m], points up to this distance outside the collider are
    included."""

    def __init__(self, contact: CondensedContact, name: str, collider: Collider, band: float) -> None:
        self._contact, self._name, self._collider = contact, name, collider
        self._areas, self._band = contact.loaded.areas, band

    def measure(self, solved: SolvedContact | None) -> ContactState | None:
        """The contact state of a solved contact; None where it does not include this collider."""
        name = self._name
        if solved is None or name not in solved.near:
            return None
        near, points, own = (
            solved.near[name],
            self._contact.points,
            solved.owned_by(name) & ~solved.is_pressed,
        )
        index, pose, m = near.index, near.pose, len(near.index)
        F = pose.rotation.T @ points.deformation(solved.rows, index)
        v = self._contact.compliance.displacement(index, *self._contact.node_forces(solved))
        rest_normal = points.material.surface_normal[index]
        R = nearest_rotations(F)
        moved = kernels.to_world(R, v)
        if points.scale is not None:
            moved *= points.scale.scale(F, rest_normal)[:, None]
        z = pose.apply_inverse(near.position)
        distance, slope, curvature = self._collider.sdf_derivatives(np.concatenate([z, z + moved]))
        force = np.zeros_like(moved)
        force[np.searchsorted(index, solved.active[own])] = solved.drawn_force[own]
        normal = (cofactor(F) @ rest_normal[..., None])[..., 0]
        length = np.sqrt((normal * normal).sum(axis=1, keepdims=True))
        normal /= np.maximum(length, SHORTEST)
        x = np.maximum(1.0 - distance[:m] / self._band, 0.0) ** 2
        weight = self._areas[index] * x / (1.0 + x)
        inputs = (
            contact_inputs(distance, slope, curvature, moved, F, normal, rest_normal),
            inputs_around(z, weight, distance, slope, moved, normal, RANGE * self._band),
            points.material.rest[index],
        )
        directions = np.stack([slope[:m], normal, moved / self._band], axis=1)
        lever = weight[:, None, None] * (directions @ R)
        depth = patch_depth(self._areas[index], distance[:m])
        pressed = self._contact.drawn_forces(solved, solved.owned_by(name) & solved.is_pressed)
        return ContactState(
            index, force, np.concatenate(inputs, axis=1), lever, depth, pressed if len(pressed[0]) else None
        )


class ContactStateProbe:
    """Solves and measures the contact of one body with one collider, state by state: for training and reports."""

    def __init__(
        self,
        body: ReducedBody,
        collider: Collider,
        mechanics: BodyMechanics,
        law: PenaltyContact,
        band: float,
        learned: LearnedEnergy | None = None,
        internal: InternalField | None = None,
    ) -> None:
        """law, learned, internal: see `CondensedContact.of`; band: see `ContactMeasurement`."""
        self._name = collider.name
        colliders = {collider.name: collider}
        self.contact = CondensedContact.of(body, mechanics, colliders, law, band, learned, internal)
        self._measurement = ContactMeasurement(self.contact, collider.name, collider, band)

    def solve(self, rows: Array, pose: RigidPose, near: SolvedContact | None = None) -> SolvedContact | None:
        """The contact at handle rows (n_rows, dim), None where no point is inside the collider. near: warm start, a
        solved contact nearby. There may be several equilibria; the solve converges to the one nearest to it."""
        points, start = self.contact.in_frame(rows), self.contact.resume(near)
        return self.contact.evaluate(points, rows, {self._name: pose}, start).solved

    def evaluation(self, solved: SolvedContact) -> ContactEvaluation:
        """The energy and derivatives of a contact that `solve` returned."""
        return self.contact.evaluation(self.contact.in_frame(solved.rows), solved.rows, solved)

    def measure(self, rows: Array, pose: RigidPose, near: SolvedContact | None = None) -> ContactState | None:
        """The contact state of the contact that `solve` returns."""
        return self._measurement.measure(self.solve(rows, pose, near))

    def measure_along(self, rows: Array, poses: Sequence[RigidPose]) -> ContactState | None:
        """The contact state at the last of several poses, with the contact followed along them from no contact."""
        near = None
        for pose in poses[:-1]:
            near = self.solve(rows, pose, near)
        return self.measure(rows, poses[-1], near)
