"""The inputs of the force model: the contact points near the collider, and the forces on them by linear mechanics.

All points on facets within a band around the collider are included, not only the active set, so that learned forces can
act where linear mechanics has none; and the points that sharp points of the collider press and that bear. These have
planes for the collider (`runtime/contact/solver/pressed_points.py`) and, for the area that they stand for, that on
which their force would be the shear modulus of the body, |l| / mu: so they enter and leave as smoothly as they bear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.colliders.collider import Collider, SdfDerivatives
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.planes import Planes
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.elasticity.invariants import cofactor
from softprint.runtime.learned.deformed_normal import SHORTEST
from softprint.runtime.learned.force.inputs import RANGE, contact_inputs, inputs_around
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.loaded_points import LoadedPoints


@dataclass(frozen=True, eq=False)
class ContactState:
    """index: (m,) contact points, ascending, in the numbering of `loaded`; force: l (m, dim) [N] by linear mechanics,
    in rest coordinates; inputs: a (m, n_contact_inputs(dim)), see `inputs.py`; lever: w R^T v_k (m, DIRECTIONS, dim)
    [m^(dim-1)] with the directions v = g, N and u / band of `inputs.py` and w = area x^2 / (1 + x^2), x = 1 - distance
    / band, C1 and zero at the edge of the band, or |l| / mu of pressed points; depth: D [m], see `patch_depth`.
    Rotating body and collider together changes none of these."""

    index: IntArray
    force: Array
    inputs: Array
    lever: Array
    depth: float
    loaded: LoadedPoints


def patch_depth(areas: Array, distance: Array) -> float:
    """The depth of the whole contact D [m] = sum a d^3 / sum a d^2, with d the depths of points without contact
    displacement at signed distances (m,). Points enter and leave it smoothly. 0 where no point is inside."""
    d = np.maximum(-distance, 0.0)
    return float(areas @ d**3 / (areas @ d**2)) if d.any() else 0.0


@dataclass(frozen=True, eq=False)
class _Near:
    """m points near a collider, and the last k of them pressed. index: (m,); position: without contact displacement (m,
    dim) [m]; F: (m, dim, dim); normal: of the surface at rest (m, dim); rest: (m, dim) [m]; planes: of the pressed
    ones, in the collider's coordinates."""

    index: IntArray
    position: Array
    F: Array
    normal: Array
    rest: Array
    planes: Planes


class ContactMeasurement:
    """Measures `ContactState`s of one body and one collider. contact: solves the contacts, with the collider under this
    name; band: [m], points up to this distance outside the collider are included; modulus: mu of the body [Pa]."""

    def __init__(
        self, contact: CondensedContact, name: str, collider: Collider, band: float, modulus: float
    ) -> None:
        self._contact, self._name, self._collider = contact, name, collider
        self._areas, self._band, self._modulus = contact.loaded.areas, band, modulus

    def measure(self, solved: SolvedContact | None) -> ContactState | None:
        """The contact state of a solved contact; None where it does not include this collider."""
        name = self._name
        if solved is None or name not in solved.near:
            return None
        pose, all_points = solved.near[name].pose, self._contact.all_points(solved.pressed)
        points, own = self._near(solved), solved.owned_by(name)
        m, F = len(points.index), pose.rotation.T @ points.F
        force = np.zeros_like(points.position)
        force[np.searchsorted(points.index, solved.active[own])] = solved.rest_force[own]
        v = all_points.compliance.displacement(points.index, *self._contact.node_forces(solved))
        R, normal = nearest_rotations(F), _deformed_normals(F, points.normal)
        moved = kernels.to_world(R, v)
        z = pose.apply_inverse(points.position)
        distance, slope, curvature = self._distances(points, z, z + moved)
        areas, nearness = self._areas_and_nearness(points, force, distance[:m])
        weight = areas * nearness
        inputs = (
            contact_inputs(distance, slope, curvature, moved, F, normal, points.normal),
            inputs_around(z, weight, distance, slope, moved, normal, RANGE * self._band),
            points.rest,
        )
        directions = np.stack([slope[:m], normal, moved / self._band], axis=1)
        lever, depth = weight[:, None, None] * (directions @ R), patch_depth(areas, distance[:m])
        return ContactState(
            points.index, force, np.concatenate(inputs, axis=1), lever, depth, all_points.loaded
        )

    def _areas_and_nearness(self, points: _Near, force: Array, distance: Array) -> tuple[Array, Array]:
        """The areas that the points stand for (m,) [m^(dim-1)], and x^2 / (1 + x^2) (m,), one for pressed points."""
        first = len(distance) - len(points.planes.place)
        pressed = np.sqrt((force[first:] ** 2).sum(axis=1)) / self._modulus
        x = np.maximum(1.0 - distance[:first] / self._band, 0.0) ** 2
        areas = np.concatenate([self._areas[points.index[:first]], pressed])
        return areas, np.concatenate([x / (1.0 + x), np.ones(len(pressed))])

    def _near(self, solved: SolvedContact) -> _Near:
        """The points on facets in the band, and the pressed points that bear."""
        near, facets, dim = solved.near[self._name], self._contact.points, solved.rows.shape[1]
        own = near.index
        columns = (
            near.position,
            facets.deformation(solved.rows, own),
            facets.material.surface_normal[own],
            facets.material.rest[own],
        )
        pressed = self._contact.all_points(solved.pressed).points
        bearing = solved.owned_by(self._name) & solved.is_pressed
        if pressed is None or solved.pressed is None or not bearing.any():
            nowhere = np.zeros((0, dim))
            return _Near(own, *columns, Planes(nowhere, nowhere))
        index = solved.active[bearing]
        which = np.searchsorted(solved.pressed.index, index)
        others = (
            solved.position[solved.solution.active[bearing]],
            pressed.deformation(solved.rows, which),
            pressed.material.surface_normal[which],
            pressed.material.rest[which],
        )
        x, F, normal, rest = (np.concatenate(both) for both in zip(columns, others, strict=True))
        return _Near(np.concatenate([own, index]), x, F, normal, rest, solved.pressed.planes(which))

    def _distances(self, points: _Near, before: Array, after: Array) -> SdfDerivatives:
        """From the collider, or the planes, of the points before displacement (m, dim) and then after it."""
        first = len(before) - len(points.planes.place)
        found = self._collider.sdf_derivatives(np.concatenate([before[:first], after[:first]]))
        both = (
            points.planes.following(SdfDerivatives(*(column[part] for column in found)), x)
            for part, x in ((slice(None, first), before), (slice(first, None), after))
        )
        return SdfDerivatives(*map(np.concatenate, zip(*both, strict=True)))


def _deformed_normals(F: Array, normal: Array) -> Array:
    """N (m, dim) of the surface, with normals at rest (m, dim), deformed by F (m, dim, dim)."""
    found = (cofactor(F) @ normal[..., None])[..., 0]
    return np.asarray(found / np.maximum(np.sqrt((found * found).sum(axis=1, keepdims=True)), SHORTEST))


def shear_modulus(body: ReducedBody) -> float:
    """mu [Pa] of most of a body's cells: the median."""
    return float(np.median(body.material.lame_mu))


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
        self._measurement = ContactMeasurement(
            self.contact, collider.name, collider, band, shear_modulus(body)
        )

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
