"""Where the loads of a body are, and how they move with its handle rows q (n_rows, dim): x and F of `equilibrium.py`.

The derivatives dx (m, dim, n_rows*dim) of m loads are needed where a Hessian is. Where nothing but the force is asked
for, that is found without them,

    sum_j f_j . (dx_j + dF_j v_j),    dx_j = U_j dq + du_j,    dF_j = dq^T grad U_j.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.body.material_points import MaterialPoints
from runtime.contact.condensed import contact_node_kernels
from runtime.linalg.row_products import deformed_some, placed, placed_some
from runtime.mechanics.static_condensation import StaticCondensation


@dataclass(frozen=True, eq=False)
class NodeMotion:
    """How m loads move with the R = n_rows * dim handle rows: of their positions dx (m, dim, R) and of F, through the
    gradients of the basis (m, n_rows, dim)."""

    position: Array
    basis_gradient: Array


class ContactNodes:
    """Of n loads. internal: of their nodes, None where U rows is all there is. turn: see `corotation.py`; index: (m,)
    which of the loads."""

    def __init__(self, points: MaterialPoints, internal: StaticCondensation | None) -> None:
        self._points, self._internal = points, internal
        self._gradients = np.ascontiguousarray(points.basis_gradient.transpose(0, 2, 1))

    def positions(self, rows: Array, turn: Array, index: IntArray | None = None) -> Array:
        """x (m, dim) [m] of some of the loads (all by default), internal response included."""
        basis = self._points.basis
        x = placed(basis, rows) if index is None else placed_some(basis, rows, index)
        return x if self._internal is None else x + self._internal.displacement(rows, turn, index)

    def deformation(self, rows: Array, index: IntArray) -> Array:
        """F (m, dim, dim)."""
        return deformed_some(self._gradients, rows, index)

    def motion(self, turn: Array, index: IntArray) -> NodeMotion:
        """The derivatives by the rows."""
        n, dim = turn.shape
        moved = (
            np.zeros((len(index), dim, n, dim))
            if self._internal is None
            else self._internal.derivative(turn, index)
        )
        contact_node_kernels.add_basis(self._points.basis, index, moved)
        return NodeMotion(moved.reshape(len(index), dim, -1), self._points.basis_gradient[index])

    def felt(self, turn: Array, index: IntArray, force: Array, given: Array) -> Array:
        """sum_j f_j . (dx_j + dF_j v_j)/drows (n_rows, dim) [N] of forces f (m, dim) on loads that keep their
        displacement v (m, dim) in rest coordinates."""
        felt = contact_node_kernels.felt(self._points.basis, self._gradients, index, force, given)
        return felt if self._internal is None else felt + self._internal.pulled_back(force, turn, index)
