"""Lines of constant rest position on a surface: they move with the body, and so show how it is strained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray

_LINES = 11  # along the longest side of the body


@dataclass(frozen=True, eq=False)
class RestGrid:
    """m segments from edge to edge of triangles. ends: (2m, 2) the vertices of the edge that each end lies on; shares:
    (2m, 1) how far along it; owner: (m,) the triangle."""

    ends: IntArray
    shares: Array
    owner: IntArray

    @classmethod
    def of(cls, rest: Array, triangles: IntArray) -> RestGrid:
        """Of the surface with vertices (s, 3) and triangles (t, 3): planes at even distances along each axis, half of
        one away from the ends, where they would coincide with edges of the body."""
        lower, upper = rest.min(axis=0), rest.max(axis=0)
        spacing = float((upper - lower).max()) / _LINES
        parts = [
            _crossings(rest[:, axis], triangles, level)
            for axis in range(3)
            for level in np.arange(lower[axis] + 0.5 * spacing, upper[axis], spacing)
        ]
        ends, shares, owner = (np.concatenate(column) for column in zip(*parts))
        return cls(ends, shares, owner)

    def points(self, x: Array) -> Array:
        """(2m, 3) the ends of the segments on the surface with vertices x (s, 3)."""
        return (1.0 - self.shares) * x[self.ends[:, 0]] + self.shares * x[self.ends[:, 1]]


def _crossings(height: Array, triangles: IntArray, level: float) -> tuple[IntArray, Array, IntArray]:
    """Where triangles with these heights (s,) at their vertices cross a level."""
    above = height[triangles] > level
    crossed = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    corners, above = triangles[crossed], above[crossed]
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    rows = np.arange(len(crossed))
    ends = np.stack(
        [np.stack([corners[rows, alone], corners[rows, (alone + k) % 3]], axis=1) for k in (1, 2)], axis=1
    ).reshape(-1, 2)
    below, beyond = height[ends[:, 0]], height[ends[:, 1]]
    return ends, ((level - below) / (beyond - below))[:, None], crossed
