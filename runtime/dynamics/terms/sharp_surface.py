"""Penalty contact and friction of tips, edges and thin limbs of colliders (`runtime/contact/sharp_contact.py`) with a
reduced body whose surface does not give way by itself: the part of `surface_contact.py` that is not at points of the
body.

With the nodes x of the surface, of which the energy W is a function, and J = dx/drows,

    gradient = J^T dW/dx,    Hessian = J^T d2W/dx2 J.

Friction acts on the points of the surface that were the nearest to sharp points where its normal forces were lagged.
During a minimisation they stay the same material points.
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
from softprint.runtime.contact.collider_coupling import Centres, Coupling, node_coupling
from softprint.runtime.contact.contact_force import SurfaceForces
from softprint.runtime.contact.friction import CoulombFriction, FrictionTerms
from softprint.runtime.contact.lagged_friction import LaggedFriction, SlidingFacetPoints, SlipStart
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.sharp_contact import SharpContact, SharpTerms
from softprint.runtime.contact.surface_quadrature import FacetPoints
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.row_products import placed
from softprint.runtime.mechanics.static_condensation import CorotatedCondensation, StaticCondensation


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
        friction: CoulombFriction | None,
        samples: IntArray,
        condensation: StaticCondensation | None,
    ) -> None:
        self.friction = friction
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

    def lag(self, start: SlipStart) -> dict[str, SlidingFacetPoints]:
        """Fix the points that sharp points of each collider press; none without friction."""
        law = self.frame.term.friction
        if law is None:
            return {}
        return {
            name: SlidingFacetPoints(
                law.lag(terms, terms.points.positions(start.nodes()), start.poses[name], self.poses[name]),
                terms.points,
            )
            for name, terms in self.terms.items()
            if len(terms.points)
        }

    def friction(self, lagged: LaggedFriction | None) -> dict[str, tuple[FacetPoints, FrictionTerms]]:
        """Friction with each collider that has lagged points, and these points."""
        law = self.frame.term.friction
        if law is None or lagged is None:
            return {}
        h = lagged.start.time_step
        return {
            name: (own.points, law.terms(own.points.positions(self.x), own.lagged.at(self.poses[name]), h))
            for name, own in lagged.sharp.items()
        }

    def friction_energy(self, lagged: LaggedFriction | None) -> float:
        """[J]"""
        return sum(terms.energy for _, terms in self.friction(lagged).values())

    def linearise(
        self,
        corrections: SampleJacobian | None,
        lagged: LaggedFriction | None,
        centres: Centres,
        n_rows: int,
    ) -> tuple[Array, Array | None, list[Coupling]]:
        """Gradient (n_rows, dim) [N] and Hessian (n_rows*dim, n_rows*dim) [N/m] of contact and friction by the rows, no
        Hessian without contact; and the couplings with the colliders that move freely, about their centres."""
        dim, friction = self.frame.term.dim, self.friction(lagged)
        gradient, hessian, couplings = np.zeros((n_rows, dim)), None, []
        for name, terms in self.terms.items():
            nodes, slope, curvature = self._by_nodes(terms, friction.get(name))
            if not len(nodes):
                continue
            jacobian = self.frame.jacobian(nodes, corrections)
            by_rows = jacobian.T @ curvature
            gradient = gradient + (jacobian.T @ slope.ravel()).reshape(-1, dim)
            hessian = by_rows @ jacobian if hessian is None else hessian + by_rows @ jacobian
            if name in centres:
                arms = self.x[nodes] - centres[name]
                couplings.append(node_coupling(name, arms, slope, curvature, jacobian))
        return gradient, hessian, couplings

    def forces(self, lagged: LaggedFriction | None) -> dict[str, tuple[list[SurfaceForces], float]]:
        """For each collider that sharp points of touch: the forces on it, and its depth [m]."""
        friction, found = self.friction(lagged), {}
        for name, terms in self.terms.items():
            parts = [self._surface_forces(terms.points, terms.gradient, tangential=False)]
            if name in friction:
                points, sliding = friction[name]
                parts.append(self._surface_forces(points, sliding.gradient, tangential=True))
            if len(terms.points) or name in friction:
                found[name] = parts, float(terms.depth.max(initial=0.0))
        return found

    def _by_nodes(
        self, terms: SharpTerms, friction: tuple[FacetPoints, FrictionTerms] | None
    ) -> tuple[IntArray, Array, Array]:
        """The nodes (k,) of the mesh that are touched, and dW/dx (k, dim) and d2W/dx2 (k*dim, k*dim)."""
        gradients = [(terms.points, terms.gradient)]
        hessians = [(terms.points.nodes, terms.hessian(self.x))] if len(terms.points) else []
        if friction is not None:
            points, sliding = friction
            gradients.append((points, sliding.gradient))
            hessians.append(points.hessian(sliding.hessian))
        nodes = np.unique(np.concatenate([points.nodes.ravel() for points, _ in gradients]))
        k, dim = len(nodes), self.frame.term.dim
        slope, curvature = np.zeros((k, dim)), np.zeros((k, k, dim, dim))
        for points, gradient in gradients:
            _add_gradient(slope, np.searchsorted(nodes, points.nodes), points.shares, gradient)
        for corners, hessian in hessians:
            at = np.searchsorted(nodes, corners)
            np.add.at(curvature, (at[:, :, None], at[:, None, :]), hessian)
        return nodes, slope, curvature.transpose(0, 2, 1, 3).reshape(k * dim, k * dim)

    def _surface_forces(self, points: FacetPoints, gradient: Array, tangential: bool) -> SurfaceForces:
        """At the nodes of the surface, of forces (k, dim) [N] at points."""
        nodes, own = np.unique(points.nodes), self.frame.term.nodes
        forces = np.zeros((len(nodes), self.frame.term.dim))
        _add_gradient(forces, np.searchsorted(nodes, points.nodes), points.shares, gradient)
        return SurfaceForces(own, np.searchsorted(own, nodes), self.x[nodes], forces, tangential)


def _add_gradient(by_nodes: Array, corners: IntArray, shares: Array, by_points: Array) -> None:
    """Adds a gradient (k, dim) by points with corners and shares (k, c) to one (n, dim) by nodes."""
    np.add.at(by_nodes, corners, shares[..., None] * by_points[:, None])
