"""Where a collider is sharper than what contact points of a body can feel: tips, edges, and thin limbs.

Contact at points of the body's surface looks up the nearest side of the collider. Beside a tip, or in a limb thinner
than the distance between these points, the nearest side is not the one that presses, and the limb goes in. There points
of the collider are compared with the surface of the body instead.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.surface_points import POINTS_ALONG, surface_points

# The curvature is measured this far outside, in spacings: a sharp edge has the curvature of a cylinder of that radius.
_OUTSIDE = 0.25
# No two points are closer than this share of the spacing.
_CLOSEST = 0.7


def sharp_points(collider: Collider, spacing: float) -> Array:
    """Points (n, dim) [m], about `spacing` [m] apart, on those parts of a collider's surface whose smaller radius of
    curvature is less than the spacing; the sharpest of neighbouring ones are chosen. In its own coordinates."""
    extent = float((collider.upper - collider.lower).max())
    if not np.isfinite(extent):
        return np.empty((0, collider.dim))
    points = surface_points(collider, max(0.5 * spacing, extent / (4 * POINTS_ALONG[collider.dim])))
    if not len(points):
        return points
    outside = _OUTSIDE * spacing
    at = collider.sdf_derivatives(points)
    normal = at.gradient / np.maximum(np.linalg.norm(at.gradient, axis=1, keepdims=True), 1e-12)
    off = collider.sdf_derivatives(points + outside * normal)
    curvature = np.linalg.eigvalsh(off.hessian)
    sharp = curvature[:, -1] > 1.0 / (spacing + outside)
    points, curvature = points[sharp], curvature[sharp].sum(axis=1)  # a corner's is twice that of an edge
    return np.asarray(points[_spread(points, np.argsort(-curvature, kind="stable"), _CLOSEST * spacing)])


def _spread(points: Array, order: IntArray, distance: float) -> IntArray:
    """Which of the points (n, dim) remain if, in the given order, each removes those closer to it than `distance`."""
    kept = np.ones(len(points), dtype=bool)
    neighbours = cKDTree(points).query_ball_point(points, distance)
    for i in order:
        if kept[i]:
            kept[neighbours[i]] = False
            kept[i] = True
    return np.flatnonzero(kept)
