"""Which of the bound points a correction has to answer for."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.body.material_points import MaterialPoints
from runtime.colliders.collider import Collider


class Reach:
    """Points whose reduced position is within `reach` [m] (a number, or (n,), one a point) of a collider."""

    def __init__(self, points: MaterialPoints, reach: float | Array) -> None:
        self._reach = np.broadcast_to(np.asarray(reach, dtype=float), len(points))
        self._limited = np.isfinite(self._reach)

    @property
    def limited(self) -> bool:
        """Whether there are points that could be out of reach."""
        return bool(self._limited.any())

    def select(self, z: Array, collider: Collider) -> IntArray:
        """Indices of the points within reach, from collider coordinates z (n, dim)."""
        margin = self._reach[:, None]
        active = ((z > collider.lower - margin) & (z < collider.upper + margin)).all(axis=1)
        doubtful = np.flatnonzero(active & self._limited)
        if doubtful.size:
            active[doubtful] = collider.sdf(z[doubtful]) < self._reach[doubtful]
        return np.flatnonzero(active)
