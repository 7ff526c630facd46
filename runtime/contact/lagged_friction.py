"""The lagged quantities of friction, which stay fixed while the energy of a step is minimised.

Coulomb friction has no potential, so its normal forces, normals and anchors come from an earlier evaluation of contact.
The step updates them in an outer loop around its minimisation (`runtime/dynamics/step/step_solve.py`), where its forces
nearly balance: before that, the normal forces between rigid surfaces are multiples of what they come to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.carriers.point_rotations import PointRotations, carried_along
from softprint.runtime.contact.friction import LaggedContact
from softprint.runtime.contact.solver.contact_solve_kernels import to_world
from softprint.runtime.contact.surface_quadrature import FacetPoints
from softprint.runtime.lazy import lazy

if TYPE_CHECKING:
    from softprint.runtime.contact.condensed.compliant_friction import CompliantPoints
    from softprint.runtime.contact.condensed.contact_evaluation import CarriedCompliance, ContactEvaluation

# Normal forces are updated where the relative residual of a step is below this ...
NEARLY_BALANCED = 0.05
# ... and so many times before, without counting: those of a start deep in a collider would hold the step back.
EARLY_UPDATES = 5


@dataclass(frozen=True, eq=False)
class SlidingPoints:
    """k active points of a condensed contact with one collider: their normal forces, normals and anchors. contact: the
    evaluation that they are of; one at other rows may have other points under these numbers. surface: how they give
    way, and are carried along; position: (k, dim) [m] at the rows of the contact, without contact displacement;
    compliance: by which they give way to friction; start: u (n,) from which friction settles."""

    lagged: LaggedContact
    index: IntArray
    contact: ContactEvaluation
    surface: CarriedCompliance
    position: Array
    compliance: CompliantPoints
    start: Array | None = None

    def positions(self, rows: Array) -> Array:
        """y (k, dim) [m] at other rows, with the contact displacement fixed in rest coordinates."""
        x = self.position + self.surface.by_rows @ (rows - self.contact.rows).ravel()
        return x + to_world(self.carriers(rows), self.surface.displacement)

    def carriers(self, rows: Array) -> Array:
        """A (k, dim, dim) at other rows."""
        return self.contact.every.carriers(rows, self.index)

    def moved(self, rows: Array, displacement: Array) -> SlidingMotion:
        """The derivatives at other rows, of points that are displaced by so much (k, dim) [m] more, in rest
        coordinates."""
        carriers = self.contact.every.carrier_derivatives(rows, self.index)
        return SlidingMotion(self.surface, carriers, self.surface.displacement + displacement)


@dataclass(frozen=True, eq=False)
class SlidingMotion:
    """The derivatives by the rows of k points y = x + A v. at: A and its derivatives; displacement: v (k, dim) [m]."""

    surface: CarriedCompliance
    at: PointRotations
    displacement: Array

    @lazy
    def carriers(self) -> Array:
        """dA (k, dim, dim, n_rows*dim)."""
        return self.at.by_rows(self.surface.basis_gradient)

    @lazy
    def jacobian(self) -> Array:
        """dy (k*dim, n_rows*dim)."""
        moved = carried_along(self.carriers, self.displacement)
        return np.asarray(self.surface.by_rows.reshape(moved.shape) + moved)

    def bending(self, forces: Array) -> Array:
        """sum_j f_j . d2y_j (n_rows*dim, n_rows*dim) of forces f (k, dim) [N]."""
        moments = forces[:, :, None] * self.displacement[:, None, :]
        return self.at.bending(moments, self.surface.basis_gradient)


@dataclass(frozen=True, eq=False)
class SlidingFacetPoints:
    """k points of facets, fixed in the body, that sharp points of one collider press: the nearest of its surface at the
    evaluation of contact that was lagged."""

    lagged: LaggedContact
    points: FacetPoints


@dataclass(frozen=True, eq=False)
class SlipStart:
    """The start of a step of length time_step [s], from which slip is measured: the surface samples (s, dim) [m] and
    the poses; contact_points: computes the deformed positions (m, dim) there of contact points (m,) of an evaluation of
    condensed contact, as far as they had given way to friction; nodes: computes the positions (n_nodes, dim) [m]
    there of the mesh, of which those of the surface are used."""

    surface: Array
    poses: Poses
    time_step: float
    contact_points: Callable[[IntArray, ContactEvaluation], Array]
    nodes: Callable[[], Array]


@dataclass(frozen=True, eq=False)
class LaggedFriction:
    """Lagged friction by collider: surface, at the surface samples; sharp, where sharp points of colliders press the
    surface; points, at the active points of condensed contact; bodies: by pair of colliders, for the surface points of
    the first inside the second."""

    start: SlipStart
    surface: Mapping[str, LaggedContact]
    sharp: Mapping[str, SlidingFacetPoints]
    points: Mapping[str, SlidingPoints]
    bodies: Mapping[tuple[str, str], LaggedContact]
