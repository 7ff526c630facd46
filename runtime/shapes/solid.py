"""Building blocks of the library's solids: fields that are negative inside, and operations that place, join, cut and
bend them.

A field maps points (n, 3) to (n,). Ball, box, capsule, cylinder and torus are signed distances, and so is, on the
outside, a union of solids that do not overlap. Cuts, blends and bends preserve only the sign and roughly the scale.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array

Field = Callable[[Array], Array]
Point = Sequence[float]


def ball(radius: float, centre: Point = (0, 0, 0)) -> Field:
    return lambda p: np.linalg.norm(p - np.array(centre), axis=1) - radius


def ellipsoid(half: Point) -> Field:
    """|p/a| (|p/a| - 1) / |p/a^2|: a distance to first order near the surface."""
    a = np.array(half)

    def field(p: Array) -> Array:
        scaled = np.linalg.norm(p / a, axis=1)
        return scaled * (scaled - 1.0) / np.maximum(np.linalg.norm(p / a**2, axis=1), 1e-12)

    return field


def box(half: Point, rounding: float = 0.0) -> Field:
    def field(p: Array) -> Array:
        return corner(np.abs(p) - np.array(half), rounding)

    return field


def corner(q: Array, rounding: float = 0.0) -> Array:
    """Distance to the intersection of orthogonal half-spaces from face distances q (n, m), with rounded edges."""
    q = q + rounding
    return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - rounding


def capsule(start: Point, end: Point, radius: float, end_radius: float | None = None) -> Field:
    """Points within a radius of a segment; if it changes along the segment, the distance is approximate."""
    a, along = np.array(start, dtype=float), np.subtract(end, start)
    growth = 0.0 if end_radius is None else end_radius - radius

    def field(p: Array) -> Array:
        t = np.clip((p - a) @ along / (along @ along), 0.0, 1.0)
        return np.linalg.norm(p - a - t[:, None] * along, axis=1) - (radius + growth * t)

    return field


def cylinder(radius: float, half_height: float, rounding: float = 0.0) -> Field:
    """About the z axis."""

    def field(p: Array) -> Array:
        across = np.hypot(p[:, 0], p[:, 1]) - radius
        return corner(np.column_stack([across, np.abs(p[:, 2]) - half_height]), rounding)

    return field


def torus(radius: float, thickness: float) -> Field:
    """About the z axis; thickness: the radius of the tube."""
    return lambda p: np.hypot(np.hypot(p[:, 0], p[:, 1]) - radius, p[:, 2]) - thickness


def half_spaces(normals: ArrayLike, distance: float) -> Field:
    """The convex solid n_i . p < distance for all of the normals (m, 3), which are normalised."""
    n = np.array(normals, dtype=float)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return lambda p: (p @ n.T).max(axis=1) - distance


def tube(curve: Array, radius: ArrayLike) -> Field:
    """A pipe along the points (m, 3) of a finely sampled curve; radius: one for all, or one each (m,)."""
    tree, radii = cKDTree(curve), np.broadcast_to(np.asarray(radius, dtype=float), len(curve))

    def field(p: Array) -> Array:
        distance, nearest = tree.query(p)
        return distance - radii[nearest]

    return field


def extruded(profile: Field, half_height: float, rounding: float = 0.0) -> Field:
    """A profile, a field of points (n, 2), along z."""

    def field(p: Array) -> Array:
        return corner(np.column_stack([profile(p[:, :2]), np.abs(p[:, 2]) - half_height]), rounding)

    return field


def revolved(profile: Field) -> Field:
    """A profile, a field of (distance from the axis, height), about z."""
    return lambda p: profile(np.column_stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]]))


def union(*fields: Field) -> Field:
    return lambda p: np.min([field(p) for field in fields], axis=0)


def common(*fields: Field) -> Field:
    return lambda p: np.max([field(p) for field in fields], axis=0)


def cut(field: Field, *tools: Field) -> Field:
    """The field's solid without those of the tools."""
    return lambda p: np.max([field(p), *(-tool(p) for tool in tools)], axis=0)


def blended(width: float, *fields: Field) -> Field:
    """The union with fillets: -w log sum_i exp(-f_i / w)."""

    def field(p: Array) -> Array:
        values = np.array([f(p) for f in fields])
        least = values.min(axis=0)
        return least - width * np.log(np.exp((least - values) / width).sum(axis=0))

    return field


def moved(field: Field, by: Point) -> Field:
    return lambda p: field(p - np.array(by))


def rotated(field: Field, axis: int, angle: float) -> Field:
    """The field rotated about a coordinate axis by an angle [rad]."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)

    def rotated_field(p: Array) -> Array:
        q = p.copy()
        q[:, i], q[:, j] = c * p[:, i] + s * p[:, j], c * p[:, j] - s * p[:, i]
        return field(q)

    return rotated_field


def twisted(field: Field, angle: float) -> Field:
    """The field rotated about z by `angle` [rad] for each unit of height."""

    def twisted_field(p: Array) -> Array:
        c, s = np.cos(angle * p[:, 2]), np.sin(angle * p[:, 2])
        return field(np.column_stack([c * p[:, 0] + s * p[:, 1], c * p[:, 1] - s * p[:, 0], p[:, 2]]))

    return twisted_field


def swollen(field: Field, by: Field) -> Field:
    """The surface moved outward by the value of `by`."""
    return lambda p: field(p) - by(p)


def ring(field: Field, count: int, start: float = 0.0) -> Field:
    """`count` copies of a solid about z."""
    return union(*(rotated(field, 2, start + 2 * np.pi * k / count) for k in range(count)))


def waves(length: float, height: float, count: int = 24, seed: int = 0) -> Field:
    """Smooth noise of this wavelength and about this height: plane waves sqrt(2/count) cos(k . p + phase).

    Directions and phases follow a golden spiral, so they are the same on every machine.
    """
    index = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * index / count, (index + 17.3 * seed) * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - z**2)
    stretch = 0.75 + 0.5 * np.modf(index * np.sqrt(2.0))[0]  # varies the wave numbers against repetition
    k = 2 * np.pi / length * stretch * np.array([across * np.cos(angle), across * np.sin(angle), z])
    phase = 2 * np.pi * np.modf((index + seed) * np.sqrt(3.0))[0]
    return lambda p: height * np.sqrt(2.0 / count) * np.cos(p @ k + phase).sum(axis=1)
