"""Positions x and deformation gradients F of the contact nodes of a body, as functions of its handle rows q (n_rows,
dim).

A Hessian needs the position Jacobian dx (m, dim, n_rows*dim) of m nodes. The force on the handles alone is computed
without it,

    sum_j f_j . (dx_j + dF_j v_j),    dx_j = U_j dq + du_j,    dF_j = dq^T grad U_j.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.contact.solver import contact_node_kernels as kernels
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.row_products import deformed_some, placed, placed_some
from softprint.runtime.mechanics.position_bounds import BoundedPositions, PositionBounds
from softprint.runtime.mechanics.static_condensation import CorotatedCondensation, StaticCondensation


@dataclass(frozen=True, eq=False)
class NodeMotion:
    """Derivatives of m nodes by the handle rows, R = n_rows * dim: dx (m, dim, R) of their positions, and the basis
    gradients (m, n_rows, dim), which give dF."""

    position: Array
    basis_gradient: Array


class ContactNodes:
    """The n contact nodes of a body. mesh_nodes: (n,) their mesh indices; condensation: of these nodes, None for a body
    without static condensation."""

    def __init__(
        self,
        points: MaterialPoints,
        condensation: StaticCondensation | None,
        handles: Handles,
        mesh_nodes: IntArray,
    ) -> None:
        self.points, self.condensation, self.mesh_nodes = points, condensation, mesh_nodes
        self.basis_gradients = np.ascontiguousarray(points.basis_gradient.transpose(0, 2, 1))
        self.bounds = None if condensation is None else PositionBounds(points.basis, condensation, handles)

    def in_frame(self, frame_rows: Array) -> CorotatedNodes:
        """In the corotated frame of a step that starts at frame rows (n_rows, dim)."""
        condensation = None if self.condensation is None else self.condensation.corotated(frame_rows)
        return CorotatedNodes(self, frame_rows, condensation)

    def deformation(self, rows: Array, index: IntArray) -> Array:
        """F (m, dim, dim) of some of the nodes (m,) at handle rows (n_rows, dim)."""
        return deformed_some(self.basis_gradients, rows, index)


@dataclass(frozen=True, eq=False)
class CorotatedNodes:
    """The contact nodes in the corotated frame of one step: x is affine in the handle rows. index: (m,) some nodes."""

    nodes: ContactNodes
    frame_rows: Array
    condensation: CorotatedCondensation | None

    def positions(self, rows: Array, index: IntArray | None = None) -> Array:
        """x (m, dim) [m] of some of the nodes (all by default), static condensation included."""
        basis = self.nodes.points.basis
        x = placed(basis, rows) if index is None else placed_some(basis, rows, index)
        return x if self.condensation is None else x + self.condensation.displacement(rows, index)

    def bounded_positions(self, rows: Array) -> tuple[Array, Array]:
        """Approximate positions (n, dim) [m] of all nodes, and bounds on their error (n,) [m]."""
        if self._bounded is None:
            basis = self.nodes.points.basis
            return placed(basis, rows), np.zeros(len(basis))
        return self._bounded(rows)

    @lazy
    def _bounded(self) -> BoundedPositions | None:
        bounds = self.nodes.bounds
        if bounds is None or self.condensation is None:
            return None
        return bounds.about(self.frame_rows, self.condensation)

    def motion(self, index: IntArray) -> NodeMotion:
        """The derivatives of some of the nodes (m,) by the rows."""
        points, (n, dim) = self.nodes.points, self.frame_rows.shape
        jacobian = (
            np.zeros((len(index), dim, n, dim))
            if self.condensation is None
            else self.condensation.jacobian(index)
        )
        kernels.add_basis(points.basis, index, jacobian)
        return NodeMotion(jacobian.reshape(len(index), dim, -1), points.basis_gradient[index])

    def handle_forces(self, index: IntArray, force: Array, v: Array) -> Array:
        """sum_j f_j . (dx_j + dF_j v_j)/drows (n_rows, dim) [N] of forces f (m, dim) on nodes whose displacement v (m,
        dim) is fixed in rest coordinates."""
        points = self.nodes.points
        forces = kernels.handle_forces(points.basis, self.nodes.basis_gradients, index, force, v)
        return forces if self.condensation is None else forces + self.condensation.pulled_back(force, index)
