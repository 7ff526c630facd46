"""A field on a grid, negative inside of a solid: its zero level as triangles, and points drawn onto it."""

from __future__ import annotations

import igl
import numpy as np
from scipy.ndimage import map_coordinates

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.shapes.solid import Field


class Grid:
    """The field on a grid over the box (lower, upper) [m], and interpolated between its nodes."""

    def __init__(self, field: Field, lower: Array, upper: Array, spacing: float) -> None:
        self.lower, self.spacing = lower, spacing
        self.nodes = np.ceil((upper - lower) / spacing).astype(int) + 1
        axes = [low + spacing * np.arange(n) for low, n in zip(lower, self.nodes)]
        z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
        self.points = np.column_stack(
            [x.ravel(), y.ravel(), z.ravel()]
        )  # marching cubes wants x to run fastest
        self.values = field(self.points)

    def __call__(self, points: Array) -> Array:
        """(n,) the field at points (n, 3), tricubic."""
        places = ((points - self.lower) / self.spacing).T[::-1]
        return np.asarray(
            map_coordinates(self.values.reshape(self.nodes[::-1]), places, order=3, mode="nearest")
        )

    def nearest(self, point: Array) -> float:
        """The field at the node nearest to a point: what one of a million calls can afford."""
        i, j, k = np.clip(np.rint((point - self.lower) / self.spacing).astype(int), 0, self.nodes - 1)
        return float(self.values[(k * self.nodes[1] + j) * self.nodes[0] + i])

    def zero_level(self) -> tuple[Array, IntArray]:
        """Vertices [m] and triangles where the field vanishes."""
        values = self.values.copy()
        near = np.abs(values) < 0.05 * self.spacing  # nodes off the surface, so that triangles keep some area
        values[near] = np.where(values[near] < 0, -0.05, 0.05) * self.spacing
        vertices, triangles, _ = igl.marching_cubes(values, self.points, *(int(n) for n in self.nodes), 0.0)
        return vertices, triangles

    def on_level(self, points: Array) -> Array:
        """Points drawn onto the level, by Newton steps along the gradient of the field."""
        for _ in range(3):
            value, step = self(points), 0.25 * self.spacing
            gradient = np.column_stack(
                [(self(points + e) - self(points - e)) / (2 * step) for e in step * np.eye(3)]
            )
            points = points - (value / np.maximum((gradient**2).sum(axis=1), 1e-3))[:, None] * gradient
        return points
