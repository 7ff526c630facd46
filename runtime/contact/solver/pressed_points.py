"""Points of the surface of a reduced body that tips, edges and thin limbs of colliders press.

A sharp point p of a collider (`runtime/colliders/sharp_points.py`) presses the point x of the deformed surface nearest
to it. During a step both stay what they are: x a material point of the body, and p with the plane through it, whose
normal g points out of the collider, fixed to the collider. The signed distance of x is that from the plane,

    s = g . (x - p),

negative where p is inside the body. g is the direction in which the collider's surface can bear: of all its normals at
p the nearest to the inward normal of the body, taken from the signed distance beside p. With that distance and the
compliance at x, these points are contact points like those on the facets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.contact.solver.contact_points import ContactPoints, CorotatedPoints, PointMotion
from softprint.runtime.contact.solver.internal_points import InternalMotion, InternalPoints
from softprint.runtime.contact.solver.planes import Planes
from softprint.runtime.linalg.means import means
from softprint.runtime.mechanics.point_condensation import CorotatedPointCondensation, PointCondensation


@dataclass(frozen=True, eq=False)
class PressedPoints:
    """j points of the surface. first: the number of contact points on the facets; index: (j,) ascending, from there on,
    their numbers among the contact points of the body; collider: (j,) number of the collider that presses each, and
    area_share: (j,) how much of the area of its sharp point does;
    corners: (j, c) nodes of the mesh, and weights: (j, c); nodes: (j, c) contact nodes, and shares: (j, c), see
    `LoadedPoints`; place: p (j, dim) [m] and direction: g (j, dim), in the collider's coordinates."""

    first: int
    index: IntArray
    collider: IntArray
    area_share: Array
    corners: IntArray
    weights: Array
    nodes: IntArray
    shares: Array
    place: Array
    direction: Array

    def planes(self, which: IntArray | slice) -> Planes:
        """The planes of some of the points (k,)."""
        return Planes(self.place[which], self.direction[which])


@dataclass(frozen=True, eq=False, kw_only=True)
class CorotatedPressedPoints(CorotatedPoints):
    """The contact points on the facets, n of them, followed by pressed points. pressed: these, with their numbers
    (j,)."""

    pressed: CorotatedPoints
    numbers: IntArray

    @classmethod
    def of(cls, of_facets: CorotatedPoints, pressed: ContactPoints, numbers: IntArray) -> CorotatedPoints:
        """In the frame of the points on the facets."""
        condensation = None
        if pressed.condensation is not None and of_facets.condensation is not None:
            # The same nodes, so that their rotations are known.
            condensation = CorotatedPointCondensation(pressed.condensation, of_facets.condensation.of_nodes)
        own = CorotatedPoints(pressed, of_facets.frame_rows, condensation, of_facets.given)
        shared = of_facets.points, of_facets.frame_rows, of_facets.condensation, of_facets.given, of_facets.step
        return cls(*shared, pressed=own, numbers=numbers)

    def positions(self, rows: Array, index: IntArray | None = None) -> Array:
        """See `CorotatedPoints`; of those on the facets by default."""
        if index is None:
            return super().positions(rows)
        own, others = self._split(index)
        first = super().positions(rows, own)
        return np.concatenate([first, self.pressed.positions(rows, others)]) if len(others) else first

    def given_displacement(self, index: IntArray) -> Array:
        """See `CorotatedPoints`."""
        own, others = self._split(index)
        first = super().given_displacement(own)
        return np.concatenate([first, self.pressed.given_displacement(others)]) if len(others) else first

    def deformation(self, rows: Array, index: IntArray) -> Array:
        """See `CorotatedPoints`."""
        own, others = self._split(index)
        first = super().deformation(rows, own)
        return np.concatenate([first, self.pressed.deformation(rows, others)]) if len(others) else first

    def surface_normals(self, index: IntArray) -> Array:
        """See `CorotatedPoints`."""
        own, others = self._split(index)
        return np.concatenate([super().surface_normals(own), self.pressed.surface_normals(others)])

    def rest(self, index: IntArray) -> Array:
        """See `CorotatedPoints`."""
        own, others = self._split(index)
        return np.concatenate([super().rest(own), self.pressed.rest(others)])

    def internal_motion(self, rows: Array, index: IntArray) -> InternalMotion | None:
        """See `CorotatedPoints`."""
        (own, others), internal = self._split(index), self.points.internal
        pressed = self.pressed.points.internal
        if internal is None or pressed is None:
            return None
        return internal.motion(rows, own, (pressed, others))

    def motion(self, index: IntArray) -> PointMotion:
        """See `CorotatedPoints`."""
        own, others = self._split(index)
        first = super().motion(own)
        if not len(others):
            return first
        second = self.pressed.motion(others)
        return PointMotion(
            np.concatenate([first.position, second.position]),
            np.concatenate([first.basis_gradient, second.basis_gradient]),
        )

    def handle_forces(self, index: IntArray, force: Array, by_strain: Array) -> Array:
        """See `CorotatedPoints`."""
        own, others = self._split(index)
        k = len(own)
        total = super().handle_forces(own, force[:k], by_strain[:k])
        if not len(others):
            return total
        return total + self.pressed.handle_forces(others, force[k:], by_strain[k:])

    def _split(self, index: IntArray) -> tuple[IntArray, IntArray]:
        """Points (m,), ascending: those on the facets, and the places of the others among the pressed points."""
        first = int(np.searchsorted(index, len(self.points.material)))
        return index[:first], np.searchsorted(self.numbers, index[first:])


@dataclass(frozen=True, eq=False)
class SurfaceNodes:
    """The nodes of the surface of a body, of which pressed points are weighted means. nodes: (k,) of the mesh,
    ascending; material: these; condensation, internal: of these, None for a body without."""

    nodes: IntArray
    material: MaterialPoints
    condensation: PointCondensation | None
    internal: InternalPoints | None

    def pressed(self, pressed: PressedPoints) -> ContactPoints:
        """The pressed points as contact points."""
        at, own = np.searchsorted(self.nodes, pressed.corners), self.material
        columns = own.rest, own.basis, own.basis_gradient, own.surface_normal
        rest, basis, gradient, normals = (means(column, at, pressed.weights) for column in columns)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        material = MaterialPoints(rest, basis, gradient, np.zeros(len(rest)), normals)
        condensation, internal = self.condensation, self.internal
        if condensation is not None:
            condensation = replace(condensation, corners=at, weights=pressed.weights, bounds=None)
        if internal is not None:
            internal = replace(internal, corners=at, weights=pressed.weights)
        bearing = pressed.nodes, pressed.shares
        return ContactPoints(material, condensation, internal, bearing)
