"""The local descriptor of a collider: its signed distance at a pattern of points around a point, rotated with the
contact frame (thesis eq. 6.4),

    phi_i(z) = phi(z + d R w_i).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.learned.thesis6.descriptors.ball_rule import sample_pattern
from softprint.runtime.learned.thesis6.descriptors.geometry import Geometry

Samples = Literal["all", "half", "one"]


class LocalDescriptor:
    """radius: d [m]; samples: which points of the pattern, "half" for those on the collider's side, w . n <= 0, and
    "one" for the centre (thesis, figure 6.6)."""

    def __init__(self, dim: int, radius: float, samples: Samples = "all") -> None:
        pattern = sample_pattern(dim)
        kept = {"all": pattern, "half": pattern[pattern[:, 0] <= 0.0], "one": pattern[:1]}
        self.radius, self._offsets = radius, radius * kept[samples]

    def __len__(self) -> int:
        """Number of values."""
        return len(self._offsets)

    def values(self, geometry: Geometry, z: Array, rotation: Array) -> Array:
        """phi (n, m) [m] at points z (n, dim) with frames R (n, dim, dim)."""
        return geometry.distance(self._around(z, rotation)).reshape(len(z), -1)

    def derivatives(self, geometry: Geometry, z: Array, rotation: Array, slope: Array) -> tuple[Array, Array]:
        """phi (n, m) [m] and dphi/dz (n, m, dim); slope: dR_ab/dz_c (n, dim, dim, dim)."""
        n, dim = z.shape
        values, gradient = geometry.distance_gradient(self._around(z, rotation))
        gradient = gradient.reshape(n, -1, dim)
        # dphi_i/dz_c = phi_,a (delta_ac + d dR_ab/dz_c w_ib)
        by_rotation = gradient @ slope.reshape(n, dim, dim * dim)  # (n, m, b.c)
        total = gradient + np.einsum("mb,nmbc->nmc", self._offsets, by_rotation.reshape(n, -1, dim, dim))
        return values.reshape(n, -1), total

    def _around(self, z: Array, rotation: Array) -> Array:
        around = z[:, None, :] + self._offsets @ rotation.transpose(0, 2, 1)
        return around.reshape(-1, z.shape[1])
