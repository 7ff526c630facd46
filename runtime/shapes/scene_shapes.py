"""Shapes for scenes only, on neither side of the split: models are neither trained nor evaluated on them."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.shapes.shape import Shape
from softprint.runtime.shapes.solid import Field, blended, common, ellipsoid, moved

# From above, the brim is the convex hull of a disc of this radius and its tip.
BRIM_RADIUS, BRIM_TIP = 0.7, 1.3
# Half of the brim's thickness, and how fast it falls off towards the edge: a wedge of 2 atan(0.35) = 39 degrees.
_HALF_THICKNESS, _SLOPE = 0.08, 0.35


def _teardrop(p: Array) -> Array:
    """Distance (n,) to the convex hull of a disc and a point, for points (n, 2); exact outside, except around the
    tip."""
    across, along = BRIM_RADIUS / BRIM_TIP, np.sqrt(1.0 - (BRIM_RADIUS / BRIM_TIP) ** 2)
    q = np.column_stack([p[:, 0], np.abs(p[:, 1])])
    beyond = q @ (along, -across) > 0.0  # beyond the tangent point, along the straight side
    return np.where(beyond, q @ (across, along), np.linalg.norm(q, axis=1)) - BRIM_RADIUS


def _brim() -> Field:
    """A sheet with a knife edge; it is flat, because the edge of a bent one would fray on the grid of its triangles."""

    def field(p: Array) -> Array:
        within = -_teardrop(p[:, :2])
        return np.maximum(np.abs(p[:, 2]) - np.minimum(_SLOPE * within, _HALF_THICKNESS), -within)

    return field


def _crown() -> Field:
    dome = moved(ellipsoid((0.5, 0.42, 0.75)), (-0.08, 0.0, 0.0))
    return common(dome, lambda p: -p[:, 2])


HAT = Shape(
    "hat",
    "a hat, whose brim has a knife edge and, in front, a point (thesis figure 6.13)",
    (1.3, 0.72, 0.78),
    blended(0.02, _crown(), _brim()),
    cells=128,
)
