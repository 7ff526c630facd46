"""Where a collider is sharper than what contact points of a body can feel: tips, edges, and thin limbs.

Contact at points of the body's surface looks up the nearest side of the collider. Beside a tip, or in a limb thinner
than the distance between these points, the nearest side is not the one that presses, and the limb goes in. There points
of the collider are compared with the surface of the body instead.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.surface_points import POINTS_ALONG, surface_points

# The curvature is measured this far outside, in spacings: a sharp edge has the curvature of a cylinder of that radius.
_OUTSIDE = 0.25
# A collider bears at a point if its normal there is nearer to the push than this cosine.
_FACING = 0.5
# Curvatures are compared in so many classes for every factor of two.
_CLASSES = 2.0
# No two points are closer than this share of the spacing.
_CLOSEST = 0.7


def sharp_points(collider: Collider, spacing: float, radius: float | None = None) -> Array:
    """Points (n, dim) [m], about `spacing` [m] apart, on those parts of a collider's surface whose smaller radius of
    curvature is less than `radius` [m], by default the spacing; the sharpest of neighbouring ones are chosen. In its
    own coordinates."""
    extent = float((collider.upper - collider.lower).max())
    if not np.isfinite(extent):
        return np.empty((0, collider.dim))
    points = surface_points(collider, max(0.5 * spacing, extent / (4 * POINTS_ALONG[collider.dim])))
    if not len(points):
        return points
    outside = _OUTSIDE * spacing
    curvature = _curvatures(collider, points, outside)
    sharp = curvature[:, -1] > 1.0 / ((spacing if radius is None else radius) + outside)
    # That of a corner is twice that of an edge; that of a saddle may be negative.
    points, curvature = points[sharp], np.maximum(curvature[sharp].sum(axis=1), 1.0 / spacing)
    # Where a tip is round, its farthest point comes first.
    farther = np.linalg.norm(points - 0.5 * (collider.lower + collider.upper), axis=1)
    order = np.lexsort((-farther, -np.round(_CLASSES * np.log2(curvature))))
    return np.asarray(points[_spread(points, order, _CLOSEST * spacing)])


def radii_of_curvature(collider: Collider, points: Array, spacing: float) -> Array:
    """The smaller radius of curvature (n,) [m] of a collider's surface at sharp points (n, dim) on it, in its own
    coordinates."""
    outside = _OUTSIDE * spacing
    curvature = _curvatures(collider, points, outside)[:, -1]
    return np.asarray(1.0 / np.maximum(curvature, 1e-12) - outside)


def away_from(points: Array, others: Array, distance: float) -> Array:
    """Those of the points (n, dim) that are farther from all the others (m, dim) than that."""
    if not len(points) or not len(others):
        return points
    return np.asarray(points[cKDTree(others).query(points)[0] > distance])


def bearing_normals(
    collider: Collider, z: Array, against: Array, spacing: Array | float
) -> tuple[Array, BoolArray]:
    """The unit normals (n, dim) with which a collider bears at sharp points z (n, dim) against pushes along the unit
    vectors -against (n, dim), and at which points (n,) it does. On a smooth part the collider has one normal, on an
    edge or a tip many, of which the nearest to `against` is the one; parts much smaller than the spacing [m], of all
    points or of each (n,), count as edges and tips. It does not bear on its sides and its back."""
    way = np.reshape(spacing, (-1, 1)) * against
    near, apart = (_unit(collider.sdf_derivatives(z + outside * way).gradient) for outside in (_OUTSIDE, 1.0))
    return apart, (near * against).sum(axis=1) > _FACING


def _curvatures(collider: Collider, points: Array, outside: float) -> Array:
    """The principal curvatures (n, dim) [1/m], ascending, that far outside of points (n, dim) on the surface."""
    normals = _unit(collider.sdf_derivatives(points).gradient)
    return np.asarray(np.linalg.eigvalsh(collider.sdf_derivatives(points + outside * normals).hessian))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _spread(points: Array, order: IntArray, distance: float) -> IntArray:
    """Which of the points (n, dim) remain if, in the given order, each removes those closer to it than `distance`."""
    kept = np.ones(len(points), dtype=bool)
    neighbours = cKDTree(points).query_ball_point(points, distance)
    for i in order:
        if kept[i]:
            kept[neighbours[i]] = False
            kept[i] = True
    return np.flatnonzero(kept)
