"""Positions x, deformation gradients F and carriers A of the contact points of a body, as functions of its handle rows
q (n_rows, dim).

A carries displacements of the body at rest along, u = A v, and turns with the deformation of the subspace there
(`runtime/contact/carriers/`). A Hessian needs the position Jacobian dx (m, dim, n_rows*dim) of m points. The force on
the handles alone is computed without it,

    sum_j f_j . dx_j + M_j : dA_j,    dx_j = U_j dq + du_j,    dF_j = dq^T grad U_j.

An internal correction of the body moves the points, too (`internal_points.py`), and so does a given displacement
(`given_displacement.py`); the formulas here are without them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.contact.carriers.point_rotations import PointRotations
from softprint.runtime.contact.solver import contact_point_kernels as kernels
from softprint.runtime.contact.solver.contact_solve_kernels import to_world
from softprint.runtime.contact.solver.given_displacement import GivenDisplacement
from softprint.runtime.contact.solver.internal_points import InternalMotion, InternalPoints
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.row_products import deformed_some, placed, placed_some
from softprint.runtime.mechanics.loaded_points import LoadedPoints
from softprint.runtime.mechanics.point_condensation import (
    BoundedPoints,
    CorotatedPointCondensation,
    PointCondensation,
)
from softprint.runtime.mechanics.static_condensation import StaticCondensation


@dataclass(frozen=True, eq=False)
class PointMotion:
    """Derivatives of m points by the handle rows, R = n_rows * dim: dx (m, dim, R) of their positions, and the basis
    gradients (m, n_rows, dim), which give dF."""

    position: Array
    basis_gradient: Array


class ContactPoints:
    """Material points of a body that may touch a collider, n of them. condensation: of these points, None for a body
    without static condensation; internal: correction of these points, None for a body without one; bearing: contact
    nodes (n, c) and shares (n, c), see `LoadedPoints`, None where nothing gives way."""

    def __init__(
        self,
        material: MaterialPoints,
        condensation: PointCondensation | None,
        internal: InternalPoints | None = None,
        bearing: tuple[IntArray, Array] | None = None,
    ) -> None:
        self.material, self.condensation, self.internal, self.bearing = material, condensation, internal, bearing
        self.basis_gradients = np.ascontiguousarray(material.basis_gradient.transpose(0, 2, 1))

    @classmethod
    def of(
        cls,
        body: ReducedBody,
        loaded: LoadedPoints,
        condensation: StaticCondensation | None,
        nodes: IntArray | None = None,
        internal: InternalField | None = None,
    ) -> ContactPoints:
        """The loaded points of a body; condensation: of all its nodes; nodes: see `PointCondensation.at`."""
        at = loaded.corners, loaded.weights, nodes
        return cls(
            loaded.material(body),
            None if condensation is None else PointCondensation.at(body, condensation, *at),
            None if internal is None else InternalPoints.at(internal, *at),
            (loaded.nodes, loaded.shares),
        )

    def in_frame(self, frame_rows: Array) -> CorotatedPoints:
        """In the corotated frame of a step that starts at frame rows (n_rows, dim)."""
        condensation = None if self.condensation is None else self.condensation.corotated(frame_rows)
        return CorotatedPoints(self, frame_rows, condensation)

    def deformation(self, rows: Array, index: IntArray) -> Array:
        """F (m, dim, dim) of some of the points (m,) at handle rows (n_rows, dim)."""
        return deformed_some(self.basis_gradients, rows, index)


@dataclass(frozen=True, eq=False)
class CorotatedPoints:
    """The contact points in the corotated frame of one step: without internal correction and given displacement x is
    affine in the handle rows. given: None for none; step: the same object for all points of one step. index: (m,)
    some."""

    points: ContactPoints
    frame_rows: Array
    condensation: CorotatedPointCondensation | None
    given: GivenDisplacement | None = None
    step: object = field(default_factory=object, repr=False)
    _last: list[tuple[Array, Array, Array]] = field(default_factory=list, repr=False, kw_only=True)

    def displaced(self, given: GivenDisplacement) -> CorotatedPoints:
        """The same points with a given displacement."""
        return CorotatedPoints(self.points, self.frame_rows, self.condensation, given, self.step)

    def positions(self, rows: Array, index: IntArray | None = None) -> Array:
        """x (m, dim) [m] of some of the points (all by default), static condensation, internal correction and given
        displacement included."""
        basis, internal = self.points.material.basis, self.points.internal
        x = placed(basis, rows) if index is None else placed_some(basis, rows, index)
        if self.condensation is not None:
            x = x + self.condensation.displacement(rows, index)
        if internal is not None:
            x = x + internal.displacement(rows, index)
        if self.given is None:
            return x
        index = np.arange(len(x)) if index is None else index
        return np.asarray(x + to_world(self.carriers(rows, index), self.given_displacement(index)))

    def given_displacement(self, index: IntArray) -> Array:
        """c (m, dim) [m] of some of the points (m,), in rest coordinates."""
        if self.given is None or self.points.bearing is None:
            return np.zeros((len(index), self.frame_rows.shape[1]))
        nodes, shares = self.points.bearing
        return self.given.of_points(nodes[index], shares[index])

    def deformation(self, rows: Array, index: IntArray) -> Array:
        """F (m, dim, dim) of some of the points (m,) at handle rows (n_rows, dim)."""
        return self.points.deformation(rows, index)

    def carriers(self, rows: Array, index: IntArray) -> Array:
        """A (m, dim, dim) of some of the points (m,) at handle rows (n_rows, dim)."""
        return nearest_rotations(self.deformation(rows, index))

    def carrier_derivatives(self, rows: Array, index: IntArray) -> PointRotations:
        """A and its derivatives at some of the points (m,)."""
        return PointRotations(self.deformation(rows, index))

    def surface_normals(self, index: IntArray) -> Array:
        """N (m, dim) of some of the points (m,), at rest."""
        return np.asarray(self.points.material.surface_normal[index])

    def rest(self, index: IntArray) -> Array:
        """Positions (m, dim) [m] of some of the points (m,) at rest."""
        return np.asarray(self.points.material.rest[index])

    def bounded_positions(self, rows: Array) -> tuple[Array, Array]:
        """Approximate positions (n, dim) [m] of all points, and bounds on their error (n,) [m]. The last are kept; this
        affects the cost and never the result."""
        last = self._last[0] if self._last else None  # read once, as another thread may replace it
        if last is None or last[0] is not rows:
            basis, internal = self.points.material.basis, self.points.internal
            if self._bounded is None:
                x, reach = placed(basis, rows), np.zeros(len(basis))
            else:
                x, reach = self._bounded(rows)
            if self.given is not None:
                reach = reach + self.given.farthest
            last = rows, x if internal is None else x + internal.displacement(rows), reach
            self._last[:] = [last]
        return last[1:]

    @property
    def bounds_are_exact(self) -> bool:
        """Whether the approximate positions are exact."""
        return self.condensation is None and self.given is None

    @lazy
    def _bounded(self) -> BoundedPoints | None:
        return None if self.condensation is None else self.condensation.bounded(self.frame_rows)

    def internal_motion(self, rows: Array, index: IntArray) -> InternalMotion | None:
        """What an internal correction adds to the derivatives of some of the points (m,) at handle rows (n_rows, dim);
        None without one."""
        internal = self.points.internal
        return None if internal is None else internal.motion(rows, index)

    def motion(self, index: IntArray) -> PointMotion:
        """The derivatives of some of the points (m,) by the rows."""
        material, (n, dim) = self.points.material, self.frame_rows.shape
        jacobian = (
            np.zeros((len(index), dim, n, dim))
            if self.condensation is None
            else self.condensation.jacobian(index)
        )
        kernels.add_basis(material.basis, index, jacobian)
        return PointMotion(jacobian.reshape(len(index), dim, n * dim), material.basis_gradient[index])

    def handle_forces(self, index: IntArray, force: Array, by_strain: Array) -> Array:
        """sum_j [ f_j . dx_j + S_j : dF_j ] / drows (n_rows, dim) [N] of forces f (m, dim) on points, and S (m, dim,
        dim) [J]."""
        material = self.points.material
        forces = kernels.handle_forces(material.basis, self.points.basis_gradients, index, force, by_strain)
        return forces if self.condensation is None else forces + self.condensation.pulled_back(force, index)
