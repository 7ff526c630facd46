"""Points on the surface of any collider, edges and corners among them."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider

# Points along the longest side of a collider.
POINTS_ALONG = {2: 400, 3: 48}
# A grid point this close inside, in spacings, is projected; outside as far as sqrt(dim), the distance from a corner
# within which its octant contains a point of the grid.
_INSIDE = 0.5
_PROJECTIONS = 4
# A projection has converged if it is this close, in spacings.
_CLOSE = 1e-3


def surface_points(collider: Collider, spacing: float | None = None) -> Array:
    """Points (n, dim) [m] on the surface of a collider, in its own coordinates, some `spacing` [m] apart; by default
    the longest side has POINTS_ALONG. None for a collider without bounds.

    They are the points of a grid near the surface, projected on it along the gradient of the signed distance. Points
    outside a convex edge or corner come to lie on it, and both sides of a wall thinner than the spacing have points.
    """
    extent = collider.upper - collider.lower
    if not np.isfinite(extent).all():
        return np.empty((0, collider.dim))
    spacing = float(extent.max()) / POINTS_ALONG[collider.dim] if spacing is None else spacing
    counts = np.ceil(extent / spacing).astype(int) + 5
    first = collider.lower + 0.5 * (extent - spacing * (counts - 1))
    axes = [low + spacing * np.arange(count) for low, count in zip(first, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, collider.dim)
    distance = collider.sdf(grid) / spacing
    z = grid[(distance > -_INSIDE) & (distance <= np.sqrt(collider.dim))]
    for _ in range(_PROJECTIONS):
        at = collider.sdf_derivatives(z)
        slope = np.maximum(
            (at.gradient**2).sum(axis=1), 0.25
        )  # interpolated distances have slopes of about 1
        z = z - (at.value / slope)[:, None] * at.gradient
    return np.asarray(z[np.abs(collider.sdf(z)) < _CLOSE * spacing])
