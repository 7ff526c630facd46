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
from softprint.runtime.contact.carriers.carriers import carried_along
from softprint.runtime.contact.friction import LaggedContact
from softprint.runtime.contact.surface_quadrature import FacetPoints

if TYPE_CHECKING:
    from softprint.runtime.contact.condensed.compliant_friction import TangentCompliance
    from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation

# Normal forces are updated where the relative residual of a step is below this.
NEARLY_BALANCED = 0.05


@dataclass(frozen=True, eq=False)
class SlidingPoints:
    """k active points of a condensed contact with one collider: their normal forces, normals and anchors, and their
    positions as an affine function of the rows: position (k, dim) [m] at those of the contact, jacobian (k, dim,
    n_rows*dim). contact: the evaluation that they are of; one at other rows may have other points under these
    numbers. carrier (k, dim, dim) and by_rows (k, dim, dim, n_rows*dim): see `CarriedCompliance`; compliance: by which
    they give way to friction; start: what friction along their tangents starts from (n,) [N]."""

    lagged: LaggedContact
    index: IntArray
    contact: ContactEvaluation
    position: Array
    jacobian: Array
    carrier: Array
    by_rows: Array
    compliance: TangentCompliance
    start: Array | None = None

    def positions(self, rows: Array) -> Array:
        """y (k, dim) [m] at other rows, with the contact displacement fixed in rest coordinates."""
        return self.position + self.jacobian @ (rows - self.contact.rows).ravel()

    def carriers(self, rows: Array) -> Array:
        """A (k, dim, dim) at other rows, to first order."""
        return np.asarray(self.carrier + self.by_rows @ (rows - self.contact.rows).ravel())

    def jacobian_with(self, displacement: Array) -> Array:
        """The derivatives (k*dim, n_rows*dim) by the rows of points that are displaced by so much (k, dim) [m] more, in
        rest coordinates."""
        k, dim = displacement.shape
        return self.jacobian.reshape(k * dim, -1) + carried_along(self.by_rows, displacement)


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
