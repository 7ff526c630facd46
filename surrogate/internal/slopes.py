"""Derivatives of the internal equilibria by the reduced state: what a truth of states also knows.

An internal equilibrium is x = U q + u, with nodal forces f(x) in the range of the constraint C and C^T u = 0
(`NullSpaceCompliance`). Differentiated along a change of the rows U dq,

    du = - G(x) K(x) U dq,

with the stiffness K and the null-space compliance G of the deformed body: one factorisation of a state gives the
derivatives by all its coordinates. For r = F^-1 (u - u_c), with u_c the static condensation if the correction adds to
it,

    dr = F^-1 (du - du_c - dF r).

The condensation turns with the body, so that du_c contains the change of its rotations; it is a central difference.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.cubature import dof_scale
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.learned.internal.correction import deformation
from softprint.runtime.mechanics.compliance.null_space_compliance import (
    NullSpaceCompliance,
    elastic_stiffness,
)
from softprint.runtime.mechanics.static_condensation import StaticCondensation

# Of the central difference, as a share of the unit of every coordinate: between round-off and curvature.
_STEP = 1e-3


class EquilibriumSlopes:
    """dr of a body along its coordinates, each in its unit (`dof_scale`). condensation: of all nodes, for a correction
    on static condensation."""

    def __init__(self, body: ReducedBody, condensation: StaticCondensation | None = None) -> None:
        self._body, self._condensation = body, condensation
        self._compliance = NullSpaceCompliance(body)
        self._gradient = basis_gradient_at_nodes(body)
        self._units = dof_scale(body.mesh, body.handles)

    def tangent(self, rows: Array) -> Array:
        """The changes of the rows (n_rows*dim, n_dofs) along the coordinates."""
        return np.asarray(self._body.handles.tangent(rows) * self._units)

    def at(self, rows: Array, internal: Array, r: Array) -> Array:
        """dr (n_nodes, dim, n_dofs) [m] at handle rows (n_rows, dim) with an internal displacement u and a correction r
        (n_nodes, dim) [m]."""
        body, tangent = self._body, self.tangent(rows)
        n, dim = body.mesh.points.shape
        change = tangent.reshape(body.n_rows, dim, -1)
        x = body.reduced_positions(rows) + internal
        K = elastic_stiffness(body.mesh, body.material, x=x)
        moved = np.tensordot(body.basis, change, axes=1).reshape(n * dim, -1)
        forces = -(K @ moved).reshape(n, dim, -1)
        du = self._compliance.with_stiffness(K).solve(forces)
        if self._condensation is not None:
            du -= self._of_condensation(rows, tangent)
        # dF r = drows^T (gradient r).
        du -= np.tensordot(np.einsum("nsj,nj->ns", self._gradient, r), change, axes=1)
        return np.asarray(np.linalg.solve(deformation(self._gradient, rows), du))

    def _of_condensation(self, rows: Array, tangent: Array) -> Array:
        """du_c (n_nodes, dim, n_dofs) [m]."""
        own = self._condensation
        assert own is not None
        changes = _STEP * tangent.T.reshape(-1, *rows.shape)
        found = [
            own.corotated(rows + change).displacement(rows + change)
            - own.corotated(rows - change).displacement(rows - change)
            for change in changes
        ]
        return np.stack(found, axis=2) / (2.0 * _STEP)
