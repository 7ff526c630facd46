"""2D profiles: fields of points (n, 2), to be extruded along z or revolved about it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from softprint.runtime.arrays import Array
from softprint.runtime.shapes.solid import Field, Point, corner


def disc(radius: float, centre: Point = (0, 0)) -> Field:
    return lambda p: np.linalg.norm(p - np.array(centre), axis=1) - radius


def rectangle(half: Point, rounding: float = 0.0, centre: Point = (0, 0)) -> Field:
    return lambda p: corner(np.abs(p - np.array(centre)) - np.array(half), rounding)


def hexagon(inner_radius: float) -> Field:
    angle = np.arange(6) * np.pi / 3
    normals = np.array([np.cos(angle), np.sin(angle)])
    return lambda p: (p @ normals).max(axis=1) - inner_radius


def toothed(teeth: int, root: float, tip: float, steepness: float = 1.6) -> Field:
    """A gear: teeth with flat tops and bottoms between two radii."""

    def field(p: Array) -> Array:
        wave = steepness * triangle_wave(teeth * np.arctan2(p[:, 1], p[:, 0]) / (2 * np.pi))
        height = 0.5 + 0.5 * np.clip(wave, -1.0, 1.0)
        return np.hypot(p[:, 0], p[:, 1]) - (root + (tip - root) * height)

    return field


def outline(radius_at: ArrayLike) -> Field:
    """A solid of revolution's half profile, from rows (height, radius) in order of height, joined by lines."""
    height, radius = np.array(radius_at, dtype=float).T

    def field(p: Array) -> Array:
        side = p[:, 0] - np.interp(p[:, 1], height, radius)
        ends = np.maximum(height[0] - p[:, 1], p[:, 1] - height[-1])
        return np.maximum(side, ends)

    return field


def triangle_wave(t: Array) -> Array:
    """1 at whole numbers, -1 halfway between them, straight in between."""
    return 4.0 * np.abs(t - np.floor(t) - 0.5) - 1.0
