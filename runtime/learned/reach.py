"""The bound points at which a correction is evaluated."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.colliders.collider import Collider


class Reach:
    """Points whose reduced position is within `reach` [m] (a number, or (n,), one per point) of a collider."""

    def __init__(self, points: MaterialPoints, reach: float | Array) -> None:
        self._reach = np.broadcast_to(np.asarray(reach, dtype=float), len(points))
        self._limited = np.isfinite(self._reach)

    @property
    def limited(self) -> bool:
        """Whether any point has a finite reach."""
        return bool(self._limited.any())

    def select(self, z: Array, collider: Collider) -> IntArray:
        """Indices of the points within reach, from collider coordinates z (n, dim)."""
        margin = self._reach[:, None]
        active = ((z > collider.lower - margin) & (z < collider.upper + margin)).all(axis=1)
        in_box = np.flatnonzero(active & self._limited)
        if in_box.size:
            active[in_box] = collider.sdf(z[in_box]) < self._reach[in_box]
        return np.flatnonzero(active)
