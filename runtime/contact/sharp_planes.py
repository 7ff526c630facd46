"""Tips, edges and thin limbs of a collider against a surface that gives way under each of them: full space.

A sharp point p of a collider (`runtime/colliders/sharp_points.py`) presses the nearest point c of the deformed surface.
As in condensed contact (`solver/pressed_points.py`), c is a material point of the body, and p has a plane through it,
with the normal g out of the collider, which are held while the energy is minimised:

    W(x) = sum_p a (k/3) d_p^3,     d = g . (p - c) where that is positive,     c = sum_i N_i x_i,

with the stiffness k of the penalty and a the area of a square (in 2D the length) between such points, so that

    dW/dx_i = -a k d^2 N_i g,     d2W/dx_i dx_j = 2 a k d N_i N_j g g^T.

After each step of the minimisation they are found again, until the forces stay: in a step of time at most six times,
because the next step of time finds them again. Without that limit, planes of an edge that slides over a rim of the body
may never settle, or leap to another equilibrium within a step.

g is the direction in which the collider can bear: of all its normals at p the nearest to the inward normal of the body
without its dent, that of a reduced state. Along c - p, the normal of a facet that the point itself tilts, it would be
held back by its own dent: the edge of a plate on a flat block without friction then has a force along the block that
depends on where it lies between the nodes. Where the collider has no such normal, on the sides of a limb that leans on
the wall of a dent, g is the inward normal of the facet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.sharp_points import bearing_normals
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.sharp_point_search import SharpPointSearch
from softprint.runtime.contact.stretched_gaps import BLUNT
from softprint.runtime.contact.surface_quadrature import FacetPoints
from softprint.runtime.elasticity.invariants import cofactor
from softprint.runtime.mesh.mesh import Mesh, facet_vectors

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody

# The planes of a solve are found again as long as that changes their forces by more than this share. Where it never
# ends in a static solve, Newton's method runs out of iterations, and says so.
_SETTLED = 0.01


@dataclass(frozen=True, eq=False)
class PlaneTerms:
    """Contact of m sharp points with the surface. points: of the surface; weight: a k (m,) [N/m^2]; depth: d (m,) [m];
    normal: g (m, dim)."""

    points: FacetPoints
    weight: Array
    depth: Array
    normal: Array

    @property
    def energy(self) -> float:
        """W [J]."""
        return float(self.weight @ self.depth**3 / 3.0)

    @property
    def gradient(self) -> Array:
        """By the points of the surface (m, dim) [N]."""
        return -(self.weight * self.depth**2)[:, None] * self.normal

    @property
    def hessian(self) -> Array:
        """By the points of the surface (m, dim, dim) [N/m]."""
        return (
            (2.0 * self.weight * self.depth)[:, None, None] * self.normal[:, :, None] * self.normal[:, None]
        )


@dataclass(frozen=True, eq=False)
class HeldPlanes:
    """k sharp points with their planes. facet: (k,) of the body's surface; points: c; place: p (k, dim) [m] and
    direction: g (k, dim), in the collider's coordinates; share: of a (k,) that bears."""

    facet: IntArray
    points: FacetPoints
    place: Array
    direction: Array
    share: Array

    def terms(self, weight: float, x: Array, pose: RigidPose) -> PlaneTerms:
        """With the nodes at x (n_nodes, dim) [m], the collider at a pose, and weight a k [N/m^2]."""
        normal = pose.rotate(self.direction)
        depth = (normal * (pose.apply(self.place) - self.points.positions(x))).sum(axis=1)
        bears = np.flatnonzero(depth > 0.0)
        points = FacetPoints(self.points.nodes[bears], self.points.shares[bears])
        return PlaneTerms(points, weight * self.share[bears], depth[bears], normal[bears])

    def on_part(self, facets: IntArray) -> HeldPlanes:
        """Those on some of the facets; facets: (f, c) their nodes by the number of the facet, -1 for others."""
        nodes = facets[self.facet]
        own = np.flatnonzero(nodes[:, 0] >= 0)
        points = FacetPoints(nodes[own], self.points.shares[own])
        return HeldPlanes(self.facet[own], points, self.place[own], self.direction[own], self.share[own])


class SharpSurface:
    """The sharp points of one collider, and the surface of a body that they press."""

    def __init__(self, collider: Collider, law: PenaltyContact, mesh: Mesh) -> None:
        """law: with contact on facets."""
        self._collider, self._margin = collider, mesh.surface_spacing
        self._search = SharpPointSearch(collider, law, mesh, BLUNT)

    @property
    def weight(self) -> float:
        """a k [N/m^2]."""
        return self._search.weight

    @classmethod
    def of(cls, collider: Collider, law: PenaltyContact, mesh: Mesh) -> SharpSurface | None:
        """None where contact is at nodes, or the collider has no sharp points."""
        found = cls(collider, law, mesh) if law.refinement else None
        return found if found is not None and len(found._search) else None

    def held(self, x: Array, pose: RigidPose, normals: Array) -> HeldPlanes:
        """The planes at nodes x (n_nodes, dim) [m] and a pose. normals: see `undented_normals`."""
        met = self._search.met(x, pose, self._margin)
        corners, shares = met.points.nodes, met.points.shares
        against = inward_normals(corners, shares, normals, pose)
        direction, bears = bearing_normals(self._collider, met.place, against, self._search.spacing)
        leaning = -_unit(pose.rotate_inverse(facet_vectors(x, corners)))
        g = np.where(bears[:, None], direction, leaning)
        return HeldPlanes(met.facet, met.points, met.place, g, met.share)


class SharpPlanes:
    """The planes of one collider's sharp points during one solve. normals: see `undented_normals`; facets: (f, dim)
    nodes of this rank on the facets of the surface, -1 for those of others; whole: gives the positions of all nodes
    from those on this rank; renewals: how often they are found again at most. All ranks call it together."""

    # In a step of time. On a plate pushed over a rim, 1, 3 and 6 give forces that differ by 4 to 10 % (RMS).
    IN_STEP = 6

    def __init__(
        self,
        surface: SharpSurface,
        normals: Array,
        facets: IntArray | None = None,
        whole: Callable[[Array], Array] | None = None,
        renewals: float = np.inf,
    ) -> None:
        self._surface, self._normals = surface, normals
        self._facets, self._whole = facets, whole
        self._renewals_left = renewals
        self._held: HeldPlanes | None = None
        self._own: HeldPlanes

    def hold(self, x: Array, pose: RigidPose) -> None:
        """The planes are those at nodes x (n, dim) [m] and a pose."""
        self._take(self._surface.held(self._all(x), pose, self._normals))

    def renew(self, x: Array, pose: RigidPose) -> bool:
        """As `hold`, where this changes the forces and was not done too often; whether it was done."""
        if self._held is None or self._renewals_left < 1:
            return False
        whole, weight = self._all(x), self._surface.weight
        found = self._surface.held(whole, pose, self._normals)
        before, after = (
            terms.points.gradient(terms.gradient, len(whole))
            for terms in (planes.terms(weight, whole, pose) for planes in (self._held, found))
        )
        if np.linalg.norm(after - before) <= _SETTLED * np.linalg.norm(after):
            return False
        self._take(found)
        self._renewals_left -= 1
        return True

    def terms(self, x: Array, pose: RigidPose) -> PlaneTerms:
        """Contact at nodes x (n, dim) [m] and a pose, of the facets on this rank."""
        if self._held is None:
            self.hold(x, pose)
        return self._own.terms(self._surface.weight, x, pose)

    def _all(self, x: Array) -> Array:
        return x if self._whole is None else self._whole(x)

    def _take(self, found: HeldPlanes) -> None:
        self._held = found
        self._own = found if self._facets is None else found.on_part(self._facets)


def undented_normals(body: ReducedBody, rows: Array) -> Array:
    """(n_nodes, dim) cof(F) n of the reduced body at the nodes of its surface: outward, of any length; 0 inside."""
    nodes, normals = body.mesh.surface_nodes, np.zeros((body.n_nodes, body.dim))
    material = body.node_points(nodes)
    F = rows.T @ material.basis_gradient
    normals[nodes] = (cofactor(F) @ material.surface_normal[..., None])[..., 0]
    return normals


def inward_normals(corners: IntArray, shares: Array, normals: Array, pose: RigidPose) -> Array:
    """Unit normals (m, dim) into the body, in the collider's coordinates, at points with corners and shares (m, c);
    normals: (n_nodes, dim) of the nodes, outward."""
    inward = -(shares[..., None] * normals[corners]).sum(axis=1) @ pose.rotation
    return _unit(inward)


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, np.finfo(np.float64).tiny))
