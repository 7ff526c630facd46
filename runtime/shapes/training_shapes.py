"""The families of the training side."""

from __future__ import annotations

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
    moved,
    ring,
    rotated,
    swollen,
    tube,
    twisted,
    union,
    waves,
)

ROUNDS = (
    Shape("ball", "a ball", (1, 1, 1), ball(1), exact=True),
    Shape("egg", "an ellipsoid of three axes", (1, 0.75, 0.6), ellipsoid((1, 0.75, 0.6))),
    Shape(
        "capsule", "a rod with round ends", (1, 0.4, 0.4), capsule((-0.6, 0, 0), (0.6, 0, 0), 0.4), exact=True
    ),
    Shape(
        "lens",
        "what two balls have in common: smooth, with a sharp rim",
        (1, 1, 0.5),
        common(ball(1.25, (0, 0, -0.75)), ball(1.25, (0, 0, 0.75))),
    ),
)

BOXES = (
    Shape("cushion", "a box with round edges", (1, 0.8, 0.6), box((1, 0.8, 0.6), 0.25), exact=True),
    Shape("slab", "a flat box with sharp edges", (1, 0.7, 0.2), box((1, 0.7, 0.2)), exact=True),
    Shape(
        "hollow_cube",
        "a cube with a ball of air in it",
        (1, 1, 1),
        cut(box((1, 1, 1), 0.15), ball(0.75)),
        voids=1,
    ),
    Shape(
        "drilled_cube",
        "a cube with a round hole along each axis",
        (1, 1, 1),
        cut(box((1, 1, 1), 0.1), *(rotated(cylinder(0.5, 2), axis, np.pi / 2) for axis in range(3))),
        holes=5,
    ),
)


def _spiked(directions: list[tuple[float, float, float]], root: float, tip: float) -> Field:
    """Cones from the origin, smoothly joined; the length of a direction is the distance of the centre of its tip."""
    return blended(0.05, *(capsule((0, 0, 0), d, root, tip) for d in directions))


CALTROPS = (
    Shape(
        "jack",
        "six equal arms with knobs",
        (1.1, 1.1, 1.1),
        blended(
            0.05,
            *(capsule(tuple(-e), tuple(e), 0.18) for e in 0.75 * np.eye(3)),
            *(ball(0.27, tuple(s * e)) for e in 0.75 * np.eye(3) for s in (-1, 1)),
        ),
    ),
    Shape(
        "caltrop",
        "four blunt points, one always up",
        (1.1, 1.1, 1.1),
        _spiked([(0.9, 0, -0.3), (-0.45, 0.78, -0.3), (-0.45, -0.78, -0.3), (0, 0, 0.95)], 0.32, 0.1),
    ),
    Shape(
        "burr",
        "twelve thorns at the corners of an icosahedron",
        (1.1, 1.1, 1.1),
        blended(
            0.04,
            ball(0.55),
            *(
                capsule((0, 0, 0), tuple(np.roll((0, a, b), shift)), 0.3, 0.06)
                for shift in range(3)
                for a in (0.5, -0.5)
                for b in (0.81, -0.81)
            ),
        ),
    ),
)

GEARS = (
    Shape(
        "gear_8",
        "eight coarse teeth and a bore",
        (1, 1, 0.3),
        extruded(cut(profile.toothed(8, 0.72, 1.0), profile.disc(0.25)), 0.3),
        holes=1,
    ),
    Shape(
        "gear_12",
        "twelve teeth about a shaft that stands out",
        (1, 1, 0.6),
        union(extruded(profile.toothed(12, 0.78, 1.0), 0.25), cylinder(0.3, 0.6)),
    ),
    Shape(
        "gear_spoked",
        "twenty teeth, five holes in the web and a bore",
        (1, 1, 0.2),
        cut(
            extruded(profile.toothed(20, 0.86, 1.0), 0.2),
            cylinder(0.16, 1),
            ring(moved(cylinder(0.19, 1), (0.5, 0, 0)), 5),
        ),
        holes=6,
    ),
    Shape(
        "gear_helical",
        "ten slanted teeth and a bore",
        (1, 1, 0.45),
        twisted(extruded(cut(profile.toothed(10, 0.75, 1.0), profile.disc(0.3)), 0.45), 0.8),
        holes=1,
    ),
)

# The dots of a braille cell, numbered down the left column and then the right.
_LETTERS = {"i": (2, 4), "k": (1, 3), "n": (1, 3, 4, 5), "o": (1, 3, 5), "s": (2, 3, 4)}
_PITCH, _CELL, _DOT = 0.5, 1.25, 0.24


def _braille(name: str, text: str) -> Shape:
    """A plate with raised dots."""
    half = (0.5 * _CELL * len(text), 0.9, 0.15)
    dots = [
        (
            (letter - 0.5 * (len(text) - 1)) * _CELL + (0.5 if dot > 3 else -0.5) * _PITCH,
            (1 - (dot - 1) % 3) * _PITCH,
            half[2],
        )
        for letter, of in enumerate(text)
        for dot in _LETTERS[of]
    ]
    field = union(box(half, 0.06), *(ball(_DOT, at) for at in dots))
    return Shape(name, f"a plate with '{text}' in raised dots", (half[0], half[1], half[2] + _DOT), field)


BRAILLE = (_braille("braille_s", "s"), _braille("braille_on", "on"), _braille("braille_ink", "ink"))


def _gyroid(p: Array) -> Array:
    s, c = np.sin(p), np.cos(p)
    return s[:, 0] * c[:, 1] + s[:, 1] * c[:, 2] + s[:, 2] * c[:, 0]


def _primitive(p: Array) -> Array:
    return np.cos(p).sum(axis=1)


def _diamond(p: Array) -> Array:
    s, c = np.sin(p), np.cos(p)
    return c.prod(axis=1) - s.prod(axis=1)


def _sheet(level: Field, wave_number: float, thickness: float, within: Field) -> Field:
    """The thickened zero surface of `level` within a solid; the gradient of the level has length about one."""
    return common(lambda p: np.abs(level(wave_number * p)) / wave_number - thickness, within)


MINIMAL = (
    Shape("gyroid", "a gyroid sheet cut to a ball", (1, 1, 1), _sheet(_gyroid, 4.5, 0.1, ball(1)), holes=10),
    Shape(
        "schwarz_p",
        "Schwarz's P surface, cut to a cube",
        (1, 1, 1),
        _sheet(_primitive, 3.6, 0.1, box((1, 1, 1))),
        holes=5,
    ),
    Shape(
        "diamond",
        "Schwarz's D surface, cut to a cylinder",
        (1, 1, 0.8),
        _sheet(_diamond, 4.0, 0.07, cylinder(1, 0.8)),
        holes=23,
    ),
)

STONES = (
    Shape(
        "pebble",
        "a flat ball with gentle waves",
        (1.2, 1.1, 0.8),
        swollen(ellipsoid((1, 0.85, 0.55)), waves(1.6, 0.05, seed=1)),
    ),
    Shape(
        "boulder",
        "a box worn by coarse and fine waves",
        (1.3, 1.2, 1.1),
        swollen(swollen(box((0.9, 0.75, 0.7), 0.35), waves(1.2, 0.06, seed=2)), waves(0.4, 0.016, seed=3)),
    ),
    Shape(
        "crumpled",
        "a ball of paper",
        (1.3, 1.3, 1.3),
        swollen(ball(0.9), lambda p: 0.35 * np.abs(waves(1.1, 0.3, seed=4)(p)) - 0.04),
    ),
)

_t = np.linspace(0.0, 1.0, 3000)
_around = 2 * np.pi * _t


def _curve(*coordinates: Array) -> Array:
    return np.column_stack(coordinates)


SWEEPS = (
    Shape(
        "spring",
        "a coil of three turns",
        (0.85, 0.85, 1.1),
        tube(_curve(0.65 * np.cos(3 * _around), 0.65 * np.sin(3 * _around), 1.7 * _t - 0.85), 0.15),
    ),
    Shape(
        "trefoil",
        "a pipe tied in a trefoil knot",
        (1.2, 1.2, 0.6),
        tube(
            _curve(
                (np.sin(_around) + 2 * np.sin(2 * _around)) / 3,
                (np.cos(_around) - 2 * np.cos(2 * _around)) / 3,
                -0.4 * np.sin(3 * _around),
            ),
            0.17,
        ),
        holes=1,
    ),
    Shape(
        "snake",
        "a bent body that thins towards its ends",
        (0.75, 0.3, 1.3),
        tube(
            _curve(
                0.45 * np.sin(1.5 * np.pi * (2 * _t - 1)),
                np.zeros_like(_t),
                np.linspace(-1.0, 1.0, len(_t)) + 0.1 * np.sin(2 * _around),
            ),
            0.12 + 0.12 * np.sin(np.pi * _t),
        ),
    ),
)


def _lobes(p: Array) -> Array:
    """Five arches around z, from -1 to 1."""
    return np.cos(2.5 * np.arctan2(p[:, 1], p[:, 0]))


FRUITS = (
    Shape(
        "pear",
        "two balls run into one another, and a stalk",
        (0.8, 0.8, 1.3),
        blended(
            0.08,
            ball(0.62, (0, 0, -0.35)),
            ball(0.34, (0, 0, 0.42)),
            capsule((0, 0, 0.7), (0.1, 0, 1.0), 0.06),
        ),
    ),
    Shape(
        "banana",
        "a bow that thins towards its ends",
        (1.2, 0.4, 0.8),
        tube(
            _curve(
                np.cos(np.pi * (0.12 + 0.76 * _t)),
                np.zeros_like(_t),
                np.sin(np.pi * (0.12 + 0.76 * _t)) - 0.75,
            ),
            0.05 + 0.22 * np.sin(np.pi * np.clip(1.04 * _t - 0.02, 0, 1)) ** 0.6,
        ),
    ),
    Shape(
        "star_fruit",
        "five ribs that run together at the ends",
        (0.9, 0.9, 1),
        swollen(
            ellipsoid((0.62, 0.62, 0.95)),
            lambda p: 0.24 * (1 - np.minimum(p[:, 2] ** 2, 1)) * (np.abs(_lobes(p)) - 0.5),
        ),
    ),
)
