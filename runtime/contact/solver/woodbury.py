"""The linearised relation between forces and displacements of the active contact points, factorised.

It is in the precision of the compliance, usually single: it only gives Newton's method a direction, and the contact
solve a warm start.

With the compliance in the deformed configuration, G_w = A G A^T, and the contact stiffness D = W L W^T in its principal
directions (`contact_solve_kernels.py`), for any displacements c of k points in the world frame

    (I + G_w D)^-1 c = c - A G V K^-1 W^T c,    D (I + G_w D)^-1 c = W K^-1 W^T c,    K = L^-1 + V^T G V,  V = A^T W.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from softprint.runtime.arrays import Array
from softprint.runtime.contact.solver import contact_point_kernels as point_kernels
from softprint.runtime.contact.solver import contact_solve_kernels as solve_kernels
from softprint.runtime.contact.solver.contact_solve import ContactSolution
from softprint.runtime.linalg.means import means, shared
from softprint.runtime.mechanics.compliance.surface_compliance_kernels import NodalCompliance

Floats = NDArray[np.floating[Any]]

# Principal directions of D that change a displacement by less than this fraction are left out.
_NEGLIGIBLE = 1e-9


class WoodburyFactor:
    """The factorisation at the k active points of a contact solution at m points; arrays are (k*dim, n).

    compliance: G; A (m, dim, dim); stiffness: a k (m,) [N/m^2].
    """

    def __init__(
        self, compliance: NodalCompliance, A: Array, stiffness: Array, solution: ContactSolution
    ) -> None:
        active, self._dim = solution.active, A.shape[1]
        self._A = A[active]
        self._compliance = compliance.taken(active, self._dim)
        state = stiffness[active], solution.penetration[active], solution.pressure[active]
        distance = solution.normal[active], solution.curvature[active]
        self._node, stiff, self._w, v = solve_kernels.stiffness_directions(
            self._compliance, self._A, np.arange(len(active)), *state, *distance, _NEGLIGIBLE
        )
        directions = self._compliance, self._node, v.astype(self.dtype)
        self._displacements = solve_kernels.displacements_along(*directions)
        K = solve_kernels.woodbury_matrix(self._compliance, self._node, stiff, directions[2])
        # Points that barely touch have no significant direction.
        self._factor = lu_factor(K, overwrite_a=True, check_finite=False) if len(K) else None

    @property
    def dtype(self) -> np.dtype[np.floating[Any]]:
        """Its precision."""
        return self._compliance.among_nodes.dtype

    def rest_displacement(self, forces: Floats) -> Floats:
        """G phi, the displacements by forces phi, both in rest coordinates."""
        G, corners, shares = self._compliance
        by_point = forces.astype(self.dtype, copy=False).reshape(-1, self._dim * forces.shape[1])
        on_nodes = shared(by_point, corners, shares, len(G) // self._dim)
        return self._at_points(G @ on_nodes.reshape(len(G), -1))

    def to_world(self, v: Floats) -> Floats:
        """A v, in the world frame."""
        return point_kernels.blocks_to_world(self._A, v)

    def to_rest(self, forces: Floats) -> Floats:
        """A^T f, in rest coordinates."""
        return point_kernels.blocks_to_world(np.ascontiguousarray(self._A.transpose(0, 2, 1)), forces)

    def effective_stiffness(self, c: Floats) -> Floats:
        """D (I + G_w D)^-1 c: the contact forces by displacements c of the compliant body."""
        return self.expanded(self.solve(self.projected(c)), len(c))

    def relaxed(self, c: Floats) -> Floats:
        """(I + G_w D)^-1 c: displacements c after the contact forces have relaxed the compliant body."""
        moved = self._at_points(self._displacements.T @ self.solve(self.projected(c)))
        return np.asarray(c - self.to_world(moved))

    def projected(self, c: Floats) -> Floats:
        """W^T c (r, n)."""
        return point_kernels.projected(self._node, self._w, c.astype(self.dtype, copy=False))

    def expanded(self, y: Floats, size: int) -> Floats:
        """W y (size, n), size = k*dim."""
        return point_kernels.expanded(self._node, self._w, y, size)

    def solve(self, right: Floats) -> Floats:
        """K^-1 right (r, n)."""
        if self._factor is None:
            return right
        # In one order, whatever the number of rows: kernels are compiled for every order that they meet.
        return np.ascontiguousarray(lu_solve(self._factor, right, check_finite=False))

    def _at_points(self, moved: Floats) -> Floats:
        """Displacements (k*dim, n) of the points, by those of the nodes."""
        _, corners, shares = self._compliance
        by_node = moved.reshape(-1, self._dim * moved.shape[1])
        at_points = means(by_node, corners, shares).reshape(-1, moved.shape[1])
        return at_points.astype(self.dtype, copy=False)
