"""The families of the testing side; none has a member on the training side."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.shapes import profile
from softprint.runtime.shapes.shape import Shape
from softprint.runtime.shapes.solid import (
    Field,
    ball,
    blended,
    box,
    capsule,
    common,
    cut,
    cylinder,
    ellipsoid,
    extruded,
    half_spaces,
    moved,
    revolved,
    rotated,
    swollen,
    torus,
    union,
    waves,
)

TORI = (
    Shape("torus", "a ring", (1, 1, 0.3), torus(0.7, 0.3), holes=1, exact=True),
    Shape(
        "double_torus",
        "two rings grown together",
        (1.1, 0.7, 0.3),
        blended(0.03, moved(torus(0.38, 0.16), (-0.45, 0, 0)), moved(torus(0.38, 0.16), (0.45, 0, 0))),
        holes=2,
    ),
    Shape(
        "hollow_torus",
        "a ring with a ring of air in it",
        (1, 1, 0.32),
        lambda p: np.abs(torus(0.68, 0.24)(p)) - 0.08,
        holes=2,
        voids=1,
    ),
)


def _thread(core: float, depth: float, pitch: float, sharpness: float) -> Field:
    """An infinite screw about z: a helical thread of the given depth around its core."""

    def field(p: Array) -> Array:
        turns = p[:, 2] / pitch - np.arctan2(p[:, 1], p[:, 0]) / (2 * np.pi)
        height = 0.5 + 0.5 * np.clip(sharpness * profile.triangle_wave(turns), -1.0, 1.0)
        return np.hypot(p[:, 0], p[:, 1]) - core - depth * height

    return field


SCREWS = (
    Shape(
        "bolt",
        "a threaded shaft with a hexagonal head",
        (0.7, 0.7, 1.0),
        union(
            common(_thread(0.26, 0.08, 0.2, 1.0), moved(cylinder(1, 0.85), (0, 0, -0.15))),
            moved(extruded(profile.hexagon(0.52), 0.16), (0, 0, 0.84)),
        ),
    ),
    Shape(
        "wood_screw",
        "a tapered thread, a countersunk head and a slot",
        (0.6, 0.6, 1.1),
        cut(
            union(
                common(
                    lambda p: _thread(0.19, 0.11, 0.24, 1.3)(p) + 0.16 * np.clip(-p[:, 2], 0, 1) ** 2,
                    moved(cylinder(1, 0.9), (0, 0, -0.1)),
                ),
                revolved(profile.outline([(0.5, 0.15), (0.85, 0.52), (1.0, 0.52)])),
            ),
            moved(box((1, 0.08, 0.12)), (0, 0, 1.0)),
        ),
    ),
    Shape(
        "worm",
        "a conveyor screw with a deep thin thread",
        (0.75, 0.75, 1),
        common(_thread(0.22, 0.45, 0.55, 3.0), cylinder(0.62, 0.9)),
    ),
)

_GOLDEN = (1 + np.sqrt(5)) / 2

POLYHEDRA = (
    Shape(
        "tetrahedron",
        "four faces",
        (1.05, 1.05, 1.05),
        half_spaces([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], 0.57),
    ),
    Shape("octahedron", "eight faces", (1, 1, 1), half_spaces(list(product((1, -1), repeat=3)), 0.57)),
    Shape(
        "dodecahedron",
        "twelve faces",
        (1, 1, 1),
        half_spaces(
            [np.roll((0, a, b * _GOLDEN), k) for k in range(3) for a in (1, -1) for b in (1, -1)], 0.75
        ),
    ),
)

VESSELS = (
    Shape(
        "mug",
        "a cup with a handle",
        (1.1, 0.75, 0.8),
        cut(
            blended(
                0.02,
                cylinder(0.65, 0.75, 0.06),
                moved(rotated(torus(0.42, 0.1), 0, np.pi / 2), (0.62, 0, 0)),
            ),
            moved(cylinder(0.52, 0.75, 0.05), (0, 0, 0.16)),
        ),
        holes=1,
    ),
    Shape(
        "flask",
        "a closed bottle with air in it",
        (0.75, 0.75, 1.1),
        cut(
            blended(0.04, ball(0.68, (0, 0, -0.35)), capsule((0, 0, 0), (0, 0, 0.8), 0.24)),
            blended(0.04, ball(0.53, (0, 0, -0.35)), capsule((0, 0, 0), (0, 0, 0.7), 0.13)),
        ),
        voids=1,
    ),
)

BRACKETS = (
    Shape(
        "angle",
        "two plates at a right angle, each with two holes",
        (0.9, 0.7, 0.7),
        cut(
            union(
                moved(box((0.85, 0.65, 0.12)), (0, 0, -0.55)),
                moved(box((0.85, 0.12, 0.65)), (0, -0.53, -0.02)),
            ),
            *(moved(cylinder(0.2, 0.3), (x, 0.12, -0.55)) for x in (-0.4, 0.4)),
            *(moved(rotated(cylinder(0.2, 0.3), 0, np.pi / 2), (x, -0.53, 0.12)) for x in (-0.4, 0.4)),
        ),
        holes=4,
    ),
    Shape(
        "nut",
        "a hexagon with a bore",
        (1, 1, 0.4),
        common(cut(extruded(profile.hexagon(0.85), 0.4), cylinder(0.45, 1)), ellipsoid((1.05, 1.05, 0.75))),
        holes=1,
    ),
    Shape(
        "key",
        "a bow with a hole, a shaft and three teeth",
        (1.1, 0.5, 0.12),
        cut(
            extruded(
                union(
                    profile.disc(0.42, (-0.6, 0)),
                    profile.rectangle((0.65, 0.1), 0.0, (0.35, 0)),
                    *(
                        profile.rectangle((0.07, 0.5 * depth), 0.0, (x, -0.5 * depth))
                        for x, depth in ((0.5, 0.36), (0.7, 0.24), (0.9, 0.32))
                    ),
                ),
                0.1,
            ),
            moved(cylinder(0.2, 1), (-0.68, 0, 0)),
        ),
        holes=1,
    ),
)


def _bone() -> Field:
    knobs = [ball(0.24, (x, y, 0.04 * y)) for x in (-0.75, 0.75) for y in (-0.17, 0.17)]
    return blended(0.06, capsule((-0.75, 0, 0), (0.75, 0, 0), 0.13), *knobs)


def _starfish() -> Field:
    arms = [
        capsule((0, 0, 0), (0.9 * np.cos(a), 0.9 * np.sin(a), 0.12 * (k % 2)), 0.26, 0.07)
        for k, a in enumerate(2 * np.pi * np.arange(5) / 5)
    ]
    return swollen(blended(0.06, ball(0.32), *arms), waves(0.25, 0.006, seed=5))


def _coral() -> Field:
    """Branches that fork three times, each pair in a plane rotated against the last."""
    branches: list[Field] = []

    def grow(start: Array, direction: Array, side: Array, length: float, radius: float, forks: int) -> None:
        end = start + length * direction
        branches.append(capsule(tuple(start), tuple(end), radius, 0.8 * radius))
        if forks:
            for sign, angle in ((1.0, 0.45), (-1.0, 0.7)):
                forked = np.cos(angle) * direction + sign * np.sin(angle) * side
                grow(end, forked, np.cross(direction, side), 0.78 * length, 0.8 * radius, forks - 1)

    grow(np.array([0, 0, -0.95]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 0.62, 0.17, 3)
    return blended(0.03, *branches)


ORGANICS = (
    Shape("bone", "a shaft with four knobs", (1.1, 0.5, 0.35), _bone()),
    Shape("starfish", "five soft arms with a rough skin", (1.15, 1.15, 0.5), _starfish()),
    Shape("coral", "branches that fork three times", (1.1, 1.1, 1.3), _coral()),
)

_CORNERS = list(product((-0.75, 0.75), repeat=3))
_EDGES = [(a, b) for a, b in combinations(_CORNERS, 2) if sum(x != y for x, y in zip(a, b)) == 1]

LATTICES = (
    Shape(
        "cage",
        "the twelve edges of a cube as rods",
        (1, 1, 1),
        blended(0.02, *(capsule(a, b, 0.15) for a, b in _EDGES)),
        holes=5,
    ),
    Shape(
        "truss",
        "a cage whose corners are tied to its middle",
        (1, 1, 1),
        blended(
            0.02, *(capsule(a, b, 0.11) for a, b in _EDGES), *(capsule((0, 0, 0), a, 0.11) for a in _CORNERS)
        ),
        holes=12,
    ),
)


def _metaballs(centres: Array, radius: float, level: float) -> Field:
    """Where the sum of Gaussians is above a level."""
    return lambda p: level - sum(np.exp(-(((p - c) / radius) ** 2).sum(axis=1)) for c in centres)


_spiral = 1.3 * np.arange(7)
_sixths = np.pi / 3 * np.arange(6)
BLOBS = (
    Shape(
        "cluster",
        "seven drops on their way into one",
        (1.2, 1.2, 1.2),
        _metaballs(
            0.5 * np.column_stack([np.cos(_spiral), np.sin(_spiral), np.linspace(-1.5, 1.5, 7)]), 0.36, 0.45
        ),
    ),
    Shape(
        "ring_of_drops",
        "six drops that touch in a ring",
        (1.2, 1.2, 0.6),
        _metaballs(0.7 * np.column_stack([np.cos(_sixths), np.sin(_sixths), np.zeros(6)]), 0.4, 0.5),
        holes=1,
    ),
)

GROUNDS = (
    Shape(
        "hills",
        "a block with a rolling top",
        (1, 0.8, 0.6),
        common(box((1, 0.8, 0.45)), lambda p: p[:, 2] - 0.15 - waves(0.9, 0.09, seed=6)(p * (1, 1, 0))),
    ),
)
