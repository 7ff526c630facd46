"""The result of a contact solve: energy, gradient, Hessian and forces of a body at one state, from one solve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray, RowHessian
from softprint.runtime.contact.collider_coupling import Centres, Coupling, Link
from softprint.runtime.contact.contact_force import ContactForce, FrictionForces, SurfaceForces, resultant
from softprint.runtime.contact.dents.dent_energies import DentCells, DentEnergies
from softprint.runtime.contact.learned_energy.hardened_contact import HardenedContact, PointForces
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.linearised.collider_sensitivity import ColliderSensitivity
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.contact_points import CorotatedPoints
from softprint.runtime.contact.solver.pressed_points import CorotatedPressedPoints
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.contact.solver.warm_start import TOO_FAR, WarmStart
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance
from softprint.runtime.mechanics.loaded_points import LoadedPoints


class CarriedCompliance(NamedTuple):
    """How k points give way and are carried along by the body. compliance: among them; displacement: v (k, dim) [m], in
    rest coordinates; by_rows: dx (k, dim, n_rows*dim) without v, and basis_gradient: (k, n_rows, dim)."""

    compliance: NodalCompliance
    displacement: Array
    by_rows: Array
    basis_gradient: Array


@dataclass(frozen=True, eq=False)
class ActivePoints:
    """The k active points of one collider. index: (k,) contact points; position, normal: (k, dim) deformed position and
    gradient of the signed distance there, world frame; pressure: p (k,) [N]; penetration: e (k,) > 0 [m]; surface:
    computes how they give way, and are carried along; across, lever: see `PointForces`, 0.0 for no lever."""

    index: IntArray
    position: Array
    normal: Array
    pressure: Array
    penetration: Array
    surface: Callable[[], CarriedCompliance]
    across: Array | None = None
    lever: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class ContactEvaluation:
    """The contact of a body at handle rows (n_rows, dim) with all colliders of a scene. nodes: (n_contact,) the contact
    nodes in the mesh; points: the contact points on the facets; every: with those that sharp points of the colliders
    press, as loaded; contact: None where the body touches no collider; learned: None for the energy of linear
    mechanics, see `LearnedEnergy`, by which energy, gradient, Hessian and forces differ from those of `contact`;
    dent_cells: in which the energies of dents are, None where nothing is learned."""

    loaded: LoadedPoints
    nodes: IntArray
    points: CorotatedPoints
    every: CorotatedPoints
    rows: Array
    colliders: tuple[str, ...]
    contact: LinearisedContact | None
    learned: LearnedEnergy | None
    dent_cells: DentCells | None

    @property
    def solved(self) -> SolvedContact | None:
        """The solved contact as plain data, for the state."""
        return None if self.contact is None else self.contact.solved

    @property
    def warm_start(self) -> WarmStart | None:
        """The warm start for contact solves of nearby states."""
        return None if self.contact is None else self.contact.start

    @property
    def converged(self) -> bool:
        """Whether the contact forces balance."""
        return self.contact is None or self.contact.solved.solution.converged

    @property
    def energy(self) -> float:
        """W [J]."""
        if self.contact is None:
            return 0.0
        return self.contact.solved.solution.energy if self.hardened is None else self.hardened.energy

    @property
    def gradient(self) -> Array:
        """dW/drows (n_rows, dim) [N]."""
        if self._active is None:
            return np.zeros_like(self.rows)
        return self._active.gradient if self.hardened is None else self.hardened.gradient

    @property
    def hessian(self) -> RowHessian | None:
        """d2W/drows2, computed when called; None where no point is active."""
        if self._active is None:
            return None
        return self._active.hessian if self.hardened is None else self.hardened.hessian

    def longest(self, change: Array) -> float:
        """1, or the share of a change of the rows (n_rows, dim) by which points in contact move just so far that their
        contact can be predicted."""
        contact = self._active
        if contact is None:
            return 1.0
        moved = (contact.derivatives.position @ change.ravel()).reshape(-1, change.shape[1])
        farthest = float(np.linalg.norm(moved, axis=1).max())
        most = TOO_FAR * contact.solved.depth
        return 1.0 if farthest <= most else most / farthest

    @property
    def _active(self) -> LinearisedContact | None:
        """The contact, if any point is active."""
        contact = self.contact
        return None if contact is None or not contact.solved.solution.active.size else contact

    @lazy
    def hardened(self) -> HardenedContact | None:
        """The contact under the learned energy; None where it is that of mechanics."""
        contact, dent = self._active, self.dent
        if contact is None or self.learned is None or dent is None:
            return None
        return HardenedContact(contact, self.learned, dent)

    @lazy
    def dent(self) -> DentEnergies | None:
        """The energies of the dent; None where no point is active, or nothing is learned."""
        contact, cells = self._active, self.dent_cells
        if contact is None or cells is None:
            return None
        solved, frame_rows = contact.solved, self.points.frame_rows
        return cells.energies(self.loaded, solved.active, solved.rest_force, self.rows, frame_rows)

    def active_points(self, name: str) -> ActivePoints:
        """The active points in contact with one collider."""
        contact = self._active
        owned = np.zeros(0, dtype=bool) if contact is None else contact.solved.owned_by(name)
        if contact is None or not owned.any():
            n_rows, dim = self.rows.shape
            index, vectors, scalars = np.empty(0, dtype=np.int64), np.empty((0, dim)), np.empty(0)
            by_rows, gradient = np.empty((0, dim, n_rows * dim)), np.empty((0, n_rows, dim))
            nothing = CarriedCompliance(
                NodalCompliance.at_nodes(np.empty((0, 0)), dim), vectors, by_rows, gradient
            )
            return ActivePoints(index, vectors, vectors, scalars, scalars, lambda: nothing)
        solved, hardened = contact.solved, self.hardened
        b = solved.solution.active[owned]
        forces = PointForces(solved.solution.pressure[b])
        if hardened is not None:
            forces = hardened.point_forces.among(owned)
        shape = len(solved.active), self.rows.shape[1], self.rows.size
        return ActivePoints(
            solved.index[b],
            solved.deformed_position[b],
            solved.solution.normal[b],
            forces.pressure,
            solved.solution.penetration[b],
            lambda: CarriedCompliance(
                contact.start.compliance.among(solved.index[b]),
                solved.solution.rest_displacement[b],
                contact.derivatives.position.reshape(shape)[owned],
                contact.derivatives.basis_gradient[owned],
            ),
            forces.across,
            forces.lever,
        )

    def forces(self) -> dict[str, ContactForce]:
        """The contact force on every collider, without friction."""
        return {name: self._force(name) for name in self.colliders}

    def _force(self, name: str) -> ContactForce:
        active = self.active_points(name)
        # A point pushes the collider against the gradient of its signed distance.
        push, at = -active.pressure[:, None] * active.normal, active.position
        parts = [self.surface_forces(active.index, at + active.lever, push)]
        if active.across is not None:
            parts.append(self.surface_forces(active.index, at, -active.across, tangential=True))
        origin = (
            np.zeros(self.rows.shape[1])
            if self.solved is None or name not in self.solved.poses
            else self.solved.poses[name].translation
        )
        penetration = float(active.penetration.max(initial=0.0))
        return ContactForce(*resultant(parts, origin), penetration, len(active.index), parts)

    def surface_forces(
        self, index: IntArray, position: Array, force: Array, tangential: bool = False
    ) -> SurfaceForces:
        """The forces (m, dim) on a collider at contact points (m,), at their deformed positions (m, dim)."""
        nodes, forces = self.loaded.felt(index, force)
        places = np.repeat(position, self.loaded.nodes.shape[1], axis=0)
        return SurfaceForces(self.nodes, nodes, places, forces, tangential)

    def couplings(self, centres: Centres) -> tuple[list[Coupling], list[Link]]:
        """The couplings of freely moving colliders, about their centres of mass, with the body, and with each other
        through the body."""
        contact = self._active
        if contact is None:
            return [], []
        owned = {name: contact.solved.owned_by(name) for name in contact.solved.near if name in centres}
        touched = {
            name: ColliderSensitivity(contact, centres[name], mine)
            for name, mine in owned.items()
            if mine.any()
        }
        pairs = [(one, other) for one in touched for other in touched if one < other]
        of = self.hardened
        if of is None:
            couplings = [Coupling(name, own.gradient, own.blocks) for name, own in touched.items()]
            return couplings, [
                Link(one, other, partial(touched[one].link, touched[other])) for one, other in pairs
            ]
        couplings = [
            Coupling(name, of.twist_gradient(own), partial(of.blocks, own)) for name, own in touched.items()
        ]
        return couplings, [
            Link(one, other, partial(of.link, touched[one], touched[other])) for one, other in pairs
        ]

    def deformed_positions(
        self, index: IntArray, of: ContactEvaluation | None = None, friction: FrictionForces | None = None
    ) -> Array:
        """Deformed positions y = x + A v (m, dim) [m] of any contact points (m,). of: an evaluation among whose pressed
        points these may be, by default this one; friction: to which they have given way, too."""
        every, compliance = self.every, None if self.contact is None else self.contact.start.compliance
        if of is not None and isinstance(of.every, CorotatedPressedPoints) and of.contact is not None:
            every = CorotatedPressedPoints.of(self.points, of.every.pressed.points, of.every.numbers)
            compliance = of.contact.start.compliance
        x = every.positions(self.rows, index)
        if self.contact is None or compliance is None:
            return x
        v = compliance.displacement(index, *self.contact.start.node_forces)
        if friction is not None:
            v = v + compliance.displacement(index, friction.nodes, friction.forces)
        return np.asarray(x + kernels.to_world(every.carriers(self.rows, index), v))
