"""Shapes for scenes alone, on neither side of the split: models are neither trained on them nor counted by them."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.shapes.shape import Shape
from runtime.shapes.solid import Field, blended, common, ellipsoid, moved

# The brim seen from above is a disc of this radius and the straight lines from there to its tip.
BRIM_RADIUS, BRIM_TIP = 0.7, 1.3
# Half of the brim's thickness, and how fast it falls off towards the edge: a wedge of 2 atan(0.35) = 39 degrees.
_HALF_THICKNESS, _SLOPE = 0.08, 0.35


def _teardrop(p: Array) -> Array:
    """Distance (n,) from the convex hull of a disc and a point, for points (n, 2): outside exact but around the tip."""
    across, along = BRIM_RADIUS / BRIM_TIP, np.sqrt(1.0 - (BRIM_RADIUS / BRIM_TIP) ** 2)
    q = np.column_stack([p[:, 0], np.abs(p[:, 1])])
    beyond = q @ (along, -across) > 0.0  # the point where the straight line begins
    return np.where(beyond, q @ (across, along), np.linalg.norm(q, axis=1)) - BRIM_RADIUS


def _brim() -> Field:
    """A sheet that runs out in a knife edge; flat, for the grid that its triangles come from would fray a bent one."""

    def field(p: Array) -> Array:
        within = -_teardrop(p[:, :2])
        return np.maximum(np.abs(p[:, 2]) - np.minimum(_SLOPE * within, _HALF_THICKNESS), -within)

    return field


def _crown() -> Field:
    dome = moved(ellipsoid((0.5, 0.42, 0.75)), (-0.08, 0.0, 0.0))
    return common(dome, lambda p: -p[:, 2])


HAT = Shape(
    "hat",
    "a hat, whose brim runs out in a knife edge and, in front, in a point (thesis figure 6.13)",
    (1.3, 0.72, 0.78),
    blended(0.02, _crown(), _brim()),
    cells=128,
)
