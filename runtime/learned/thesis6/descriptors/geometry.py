"""The geometry of a collider that descriptors need, from its signed distance directly or from fields on grids.

The interpolated fields, distance and smoothed gradient, are smooth and independent of frames: everything computed from
them at a point is C2 in the point (thesis 6.3 interpolates deformations, whose slope jumps from cell to cell).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.sampled.spline import SplineGrid
from softprint.runtime.learned.thesis6.descriptors.smoothed_gradient import SmoothedGradient, unit_normal

# Cells along the largest side of a collider enlarged by d: of the smoothed gradient, which varies over d, and of the
# distance. Errors for a torus, with d 0.6 of its size: 7 um and 0.6 degrees RMS, computed in 2.5 s; with 40 and 96
# cells 1 um and 0.4 degrees, in 10 s.
GRADIENT_CELLS, DISTANCE_CELLS = 24, 64


class Geometry(Protocol):
    """A collider's neighbourhood, in its own coordinates."""

    def smoothed(self, z: Array) -> Array:
        """Smoothed gradient g (n, dim) at points z (n, dim)."""
        ...

    def smoothed_derivatives(self, z: Array) -> tuple[Array, Array]:
        """g (n, dim) and dg_a/dz_c (n, dim, dim) [1/m]."""
        ...

    def normal(self, z: Array) -> Array:
        """Smoothed unit normal (n, dim)."""
        return unit_normal(self.smoothed(z))

    def distance(self, z: Array) -> Array:
        """Signed distance (n,) [m]."""
        ...

    def distance_gradient(self, z: Array) -> tuple[Array, Array]:
        """Signed distance (n,) [m] and its gradient (n, dim)."""
        ...


class DirectGeometry(Geometry):
    """Evaluated from the collider directly. radius: d [m]; sets: of differences in the smoothed gradient."""

    def __init__(self, collider: Collider, radius: float, sets: int) -> None:
        self._collider = collider
        self._smoothed = SmoothedGradient(collider, radius, sets)

    def smoothed(self, z: Array) -> Array:
        """See `Geometry`."""
        return self._smoothed.value(z)

    def smoothed_derivatives(self, z: Array) -> tuple[Array, Array]:
        """See `Geometry`."""
        return self._smoothed.derivatives(z)

    def distance(self, z: Array) -> Array:
        """See `Geometry`."""
        return self._collider.sdf(z)

    def distance_gradient(self, z: Array) -> tuple[Array, Array]:
        """See `Geometry`."""
        found = self._collider.sdf_derivatives(z)
        return found.value, found.gradient


class GridGeometry(Geometry):
    """Distance and smoothed gradient from cubic splines on grids around the collider, for points within d of its
    bounds; precomputed in seconds."""

    def __init__(
        self,
        collider: Collider,
        radius: float,
        sets: int,
        gradient_cells: int = GRADIENT_CELLS,
        distance_cells: int = DISTANCE_CELLS,
    ) -> None:
        largest = float((collider.upper - collider.lower).max()) + 2 * radius
        nodes, shape, origin, spacing = _nodes(collider, radius, largest / gradient_cells)
        smoothed = SmoothedGradient(collider, radius, sets).value(nodes)
        self._gradient = [SplineGrid(column.reshape(shape), origin, spacing) for column in smoothed.T]
        # The points of a pattern are up to d from a point that is up to d from the bounds.
        nodes, shape, origin, spacing = _nodes(collider, 2 * radius, largest / distance_cells)
        self._distance = SplineGrid(collider.sdf(nodes).reshape(shape), origin, spacing)

    def smoothed(self, z: Array) -> Array:
        """See `Geometry`."""
        return np.column_stack([grid.value(z) for grid in self._gradient])

    def smoothed_derivatives(self, z: Array) -> tuple[Array, Array]:
        """See `Geometry`."""
        values, slopes = zip(*(grid.gradients(z) for grid in self._gradient), strict=True)
        return np.column_stack(values), np.stack(slopes, axis=1)

    def distance(self, z: Array) -> Array:
        """See `Geometry`."""
        return self._distance.value(z)

    def distance_gradient(self, z: Array) -> tuple[Array, Array]:
        """See `Geometry`."""
        return self._distance.gradients(z)


def _nodes(collider: Collider, margin: float, spacing: float) -> tuple[Array, Array, Array, float]:
    """Nodes (k, dim) of a grid about the collider's bounds, its shape, origin and spacing."""
    cells = np.ceil((collider.upper - collider.lower + 2 * margin) / spacing).astype(int) + 2
    origin = 0.5 * (collider.lower + collider.upper - cells * spacing)
    axes = [o + spacing * np.arange(c + 1) for o, c in zip(origin, cells, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(cells))
    return nodes, cells + 1, origin, spacing
