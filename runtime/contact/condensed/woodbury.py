"""How forces and displacements of loads that bear pressure answer each other, to first order, factorised.

In the precision of the compliance, single as a rule: Newton's method takes a direction from it, and a load where to
start from.

With G carried along to the world, G_w = F G F^T, and the stiffening D = W L W^T of the contact in its principal
directions (`contact_solve_kernels.py`), for any displacements c of k loads in the world

    (I + G_w D)^-1 c = c - F G V K^-1 W^T c,    D (I + G_w D)^-1 c = W K^-1 W^T c,    K = L^-1 + V^T G V,  V = F^T W.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from runtime.contact.condensed import contact_node_kernels, contact_solve_kernels
from runtime.contact.condensed.contact_solve import ContactProblem, ContactSolution

Floats = NDArray[np.floating[Any]]

# Directions that change what they meet by less than this share are left out.
_NOTHING = 1e-9


class WoodburyFactor:
    """Of the k loads that bear pressure in a solution; arrays are (k*dim, n)."""

    def __init__(self, problem: ContactProblem, solution: ContactSolution) -> None:
        b, dim = solution.bearing, problem.position.shape[1]
        self._F = problem.F[b]
        self._among = contact_node_kernels.among(problem.compliance, b, dim)
        stiffness, left, pressure = problem.stiffness[b], solution.left[b], solution.pressure[b]
        pressed = stiffness, left, pressure, solution.normal[b], solution.curvature[b]
        everyone = np.arange(len(b))
        self._load, stiff, self._w, v = contact_solve_kernels.directions(
            self._among, self._F, everyone, *pressed, _NOTHING
        )
        self._given, K = contact_solve_kernels.saddle(self._among, self._load, stiff, v.astype(self._kind))
        # Loads that only just touch have no direction that matters.
        self._factor = lu_factor(K, overwrite_a=True, check_finite=False) if len(K) else None

    @property
    def _kind(self) -> np.dtype[np.floating[Any]]:
        return self._among.dtype

    def given(self, loads: Floats) -> Floats:
        """G phi, displacements of loads phi, both in rest coordinates."""
        return np.asarray(self._among @ loads.astype(self._kind, copy=False))

    def carried(self, v: Floats) -> Floats:
        """F v, in the world."""
        return contact_node_kernels.carried(self._F, v)

    def carried_back(self, forces: Floats) -> Floats:
        """F^T f, in rest coordinates."""
        return contact_node_kernels.carried(np.ascontiguousarray(self._F.transpose(0, 2, 1)), forces)

    def stiffen(self, c: Floats) -> Floats:
        """D (I + G_w D)^-1 c."""
        return contact_node_kernels.spread(self._load, self._w, self._solve(self._along(c)), len(c))

    def soften(self, c: Floats) -> Floats:
        """(I + G_w D)^-1 c."""
        return np.asarray(c - self.carried(self._given.T @ self._solve(self._along(c))))

    def curvature(self, c: Floats) -> Floats:
        """c^T D (I + G_w D)^-1 c (n, n)."""
        along = self._along(c)
        return np.asarray(along.T @ self._solve(along))

    def _along(self, c: Floats) -> Floats:
        """W^T c (r, n)."""
        return contact_node_kernels.gathered(self._load, self._w, c.astype(self._kind, copy=False))

    def _solve(self, right: Floats) -> Floats:
        """K^-1 right (r, n)."""
        if self._factor is None:
            return right
        return np.asarray(lu_solve(self._factor, right, check_finite=False))
