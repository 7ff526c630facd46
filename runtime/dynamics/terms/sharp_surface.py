"""Penalty contact of tips, edges and thin limbs of colliders (`runtime/contact/sharp_contact.py`) with a reduced body
whose surface does not give way by itself: the part of `surface_contact.py` that is not at points of the body.

With the nodes x of the surface, of which the energy W is a function, and J = dx/drows,

    gradient = J^T dW/dx,    Hessian = J^T d2W/dx2 J.

It is without friction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.collider_coupling import Centres, Coupling
from softprint.runtime.contact.contact_force import SurfaceForces
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.sharp_contact import SharpContact, SharpTerms
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.row_products import placed
from softprint.runtime.mechanics.static_condensation import CorotatedCondensation, StaticCondensation
from softprint.runtime.rigid.twist import point_motion, relative_curvature, rotation_derivatives


class SampleJacobian(NamedTuple):
    """The Jacobian (m, dim, n_rows, dim) of the displacement by field corrections; slots: (k,) the place of each sample
    in it, -1 for those without displacement."""

    slots: IntArray
    jacobian: Array


class SharpSurface:
    """The nodes of a body's surface and the colliders, by name, that have sharp points. samples: (k,) the point at
    which the displacement of each node by field corrections is known; condensation: of all nodes of the body."""

    def __init__(
        self,
        body: ReducedBody,
        colliders: Mapping[str, Collider],
        law: PenaltyContact,
        samples: IntArray,
        condensation: StaticCondensation | None,
    ) -> None:
        found = {name: SharpContact.of(own, law, body.mesh) for name, own in colliders.items()}
        self.contacts = {name: own for name, own in found.items() if own is not None}
        self.nodes = body.mesh.surface_nodes if self.contacts else body.mesh.surface_nodes[:0]
        self.samples = samples[: len(self.nodes)]
        self.basis = np.ascontiguousarray(body.basis[self.nodes])
        self.condensation = None if condensation is None else condensation.at(self.nodes)
        self.n_nodes, self.dim = body.n_nodes, body.dim

    def in_frame(self, frame_rows: Array) -> SharpSurfaceInFrame:
        """In the corotated frame of a step that starts at frame rows (n_rows, dim)."""
        own = self.condensation
        return SharpSurfaceInFrame(self, None if own is None else own.corotated(frame_rows))


@dataclass(frozen=True, eq=False)
class SharpSurfaceInFrame:
    """The nodes in the corotated frame of one step."""

    term: SharpSurface
    condensation: CorotatedCondensation | None

    def positions(self, rows: Array, displacement: Array | None) -> Array:
        """(n_nodes, dim) [m] of the mesh, zero inside the body; displacement: of the samples, by corrections."""
        term = self.term
        x = placed(term.basis, rows)
        if self.condensation is not None:
            x += self.condensation.displacement(rows)
        if displacement is not None:
            x += displacement[term.samples]
        whole = np.full((term.n_nodes, x.shape[1]), x[0])
        whole[term.nodes] = x
        return whole

    def jacobian(self, nodes: IntArray, corrections: SampleJacobian | None) -> Array:
        """J (k*dim, n_rows*dim) of some nodes (k,) of the mesh."""
        term, index = self.term, np.searchsorted(self.term.nodes, nodes)
        basis = term.basis[index]
        dim = term.dim
        jacobian: Array = np.einsum("mr,ik->mirk", basis, np.eye(dim))
        if self.condensation is not None:
            jacobian += self.condensation.jacobian(index)
        if corrections is not None:
            own = corrections.slots[term.samples[index]]
            jacobian[own >= 0] += corrections.jacobian[own[own >= 0]]
        return jacobian.reshape(len(nodes) * dim, -1)


@dataclass(frozen=True, eq=False)
class SharpSurfaceEvaluation:
    """Contact at one state. positions: computes those of `SharpSurfaceInFrame`."""

    frame: SharpSurfaceInFrame
    positions: Callable[[], Array]
    poses: Poses

    @lazy
    def x(self) -> Array:
        """(n_nodes, dim) [m]."""
        return self.positions()

    @lazy
    def terms(self) -> dict[str, SharpTerms]:
        """Contact with each collider."""
        contacts = self.frame.term.contacts
        return {name: own.terms(self.x, self.poses[name]) for name, own in contacts.items()}

    @property
    def energy(self) -> float:
        """[J]"""
        return sum(terms.energy for terms in self.terms.values())

    def linearise(
        self, corrections: SampleJacobian | None, centres: Centres, n_rows: int
    ) -> tuple[Array, Array | None, list[Coupling]]:
        """Gradient (n_rows, dim) [N] and Hessian (n_rows*dim, n_rows*dim) [N/m] by the rows, no Hessian without
        contact; and the couplings with the colliders that move freely, about their centres."""
        dim = self.frame.term.dim
        gradient, hessian, couplings = np.zeros((n_rows, dim)), None, []
        for name, terms in self.terms.items():
            if not len(terms.points):
                continue
            nodes, slope, curvature = self._by_nodes(terms)
            jacobian = self.frame.jacobian(nodes, corrections)
            by_rows = jacobian.T @ curvature
            gradient = gradient + (jacobian.T @ slope.ravel()).reshape(-1, dim)
            hessian = by_rows @ jacobian if hessian is None else hessian + by_rows @ jacobian
            if name in centres:
                arms = self.x[nodes] - centres[name]
                couplings.append(_coupling(name, arms, slope, curvature, jacobian))
        return gradient, hessian, couplings

    def forces(self) -> dict[str, tuple[SurfaceForces, float]]:
        """For each collider that sharp points of touch: the forces on it, and its depth [m]."""
        found = {}
        for name, terms in self.terms.items():
            if len(terms.points):
                nodes, slope, _ = self._by_nodes(terms)
                own = self.frame.term.nodes
                parts = SurfaceForces(own, np.searchsorted(own, nodes), self.x[nodes], slope, False)
                found[name] = parts, float(terms.depth.max())
        return found

    def _by_nodes(self, terms: SharpTerms) -> tuple[IntArray, Array, Array]:
        """The nodes (k,) of the mesh that are pressed, and dW/dx (k, dim) and d2W/dx2 (k*dim, k*dim)."""
        nodes, corners = np.unique(terms.points.nodes, return_inverse=True)
        corners, k, dim = corners.reshape(terms.points.nodes.shape), len(nodes), self.frame.term.dim
        slope, curvature = np.zeros((k, dim)), np.zeros((k, k, dim, dim))
        np.add.at(slope, corners, terms.points.shares[..., None] * terms.gradient[:, None])
        np.add.at(curvature, (corners[:, :, None], corners[:, None, :]), terms.hessian(self.x))
        return nodes, slope, curvature.transpose(0, 2, 1, 3).reshape(k * dim, k * dim)


def _coupling(name: str, arms: Array, slope: Array, curvature: Array, jacobian: Array) -> Coupling:
    """With arms (k, dim) of the nodes from the centre of the collider. Moving the collider is moving the body the other
    way, while the forces turn with the collider."""
    motion = point_motion(arms).reshape(arms.size, -1)

    def blocks() -> tuple[Array, Array]:
        pushed = rotation_derivatives(slope).reshape(motion.shape) - curvature @ motion
        return jacobian.T @ pushed, motion.T @ curvature @ motion + relative_curvature(arms, slope)

    return Coupling(name, -(slope.ravel() @ motion), blocks)
