"""How forces and displacements of loads that bear pressure answer each other, to first order, factorised.

With G carried along to the world, G_w = F G F^T, and the stiffening D = W L W^T of the contact in its principal
directions (`load_step.py`), for any displacements c of k loads in the world

    (I + G_w D)^-1 c = c - F G V K^-1 W^T c,    D (I + G_w D)^-1 c = W K^-1 W^T c,    K = L^-1 + V^T G V,  V = F^T W.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from runtime.arrays import Array
from runtime.corrections import load_kernels, load_step
from runtime.corrections.load_solve import LoadProblem, LoadSolution

# Directions that change what they meet by less than this share are left out.
_NOTHING = 1e-9


class LoadFactor:
    """Of the k loads that bear pressure in a solution; arrays are (k*dim, n)."""

    def __init__(self, problem: LoadProblem, solution: LoadSolution) -> None:
        b, dim = solution.bearing, problem.position.shape[1]
        self._F = problem.F[b]
        self._among = load_kernels.among(problem.compliance, b, dim)
        stiffness, left, pressure = problem.stiffness[b], solution.left[b], solution.pressure[b]
        pressed = stiffness, left, pressure, solution.normal[b], solution.curvature[b]
        everyone = np.arange(len(b))
        self._load, stiff, self._w, v = load_step.directions(
            self._among, self._F, everyone, *pressed, _NOTHING
        )
        self._given, K = load_step.saddle(self._among, self._load, stiff, v)
        # Loads that only just touch have no direction that matters.
        self._factor = lu_factor(K, overwrite_a=True, check_finite=False) if len(K) else None

    def given(self, loads: Array) -> Array:
        """G phi, displacements of loads phi, both in rest coordinates."""
        return np.asarray(self._among @ loads)

    def carried(self, v: Array) -> Array:
        """F v, in the world."""
        return load_kernels.carried(self._F, v)

    def carried_back(self, forces: Array) -> Array:
        """F^T f, in rest coordinates."""
        return load_kernels.carried(np.ascontiguousarray(self._F.transpose(0, 2, 1)), forces)

    def stiffen(self, c: Array) -> Array:
        """D (I + G_w D)^-1 c."""
        return load_kernels.spread(self._load, self._w, self._solve(self._along(c)), len(c))

    def soften(self, c: Array) -> Array:
        """(I + G_w D)^-1 c."""
        return c - self.carried(self._given.T @ self._solve(self._along(c)))

    def curvature(self, c: Array) -> Array:
        """c^T D (I + G_w D)^-1 c (n, n)."""
        along = self._along(c)
        return np.asarray(along.T @ self._solve(along))

    def _along(self, c: Array) -> Array:
        """W^T c (r, n)."""
        return load_kernels.gathered(self._load, self._w, c)

    def _solve(self, right: Array) -> Array:
        """K^-1 right (r, n)."""
        if self._factor is None:
            return right
        return np.asarray(lu_solve(self._factor, right, check_finite=False))
