"""A picture of what a tactile camera sees, in plain numpy: the depth image in colours, and markers with their paths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.touch.tactile_camera import TactileCamera, TactileImage

Pixels = NDArray[np.uint8]

# From no depth to the largest: dark blue to yellow.
_COLOURS = np.array(
    [[14, 17, 48], [72, 32, 110], [166, 50, 104], [235, 105, 62], [252, 200, 80], [255, 250, 200]]
)
_MARKER, _NOWHERE = (150, 220, 255), (90, 90, 90)
_ENLARGED = 8  # picture pixels for each pixel of the depth image
_LENGTHENED = 3.0  # displacements of markers


def tactile_picture(camera: TactileCamera, image: TactileImage, deepest: float) -> Pixels:
    """(rows, columns, 3) of a pad in 3D. deepest: the depth [m] of the last colour."""
    depth = np.kron(image.depth, np.ones((_ENLARGED, _ENLARGED)))
    level = np.clip(np.nan_to_num(depth) / deepest, 0.0, 1.0) * (len(_COLOURS) - 1)
    low = np.minimum(level.astype(int), len(_COLOURS) - 2)
    share = (level - low)[..., None]
    pixels = ((1 - share) * _COLOURS[low] + share * _COLOURS[low + 1]).astype(np.uint8)
    pixels[np.isnan(depth)] = _NOWHERE
    for place, moved in zip(camera.places, image.markers[:, :2], strict=True):
        _line(pixels, _pixel(camera, pixels, place), _pixel(camera, pixels, place + _LENGTHENED * moved))
    return pixels


def _pixel(camera: TactileCamera, pixels: Pixels, place: Array) -> Array:
    """(row, column) of a place in the plane [m]."""
    share = place / camera.field + 0.5
    return np.array([(1.0 - share[1]) * pixels.shape[0], share[0] * pixels.shape[1]])


def _line(pixels: Pixels, start: Array, end: Array) -> None:
    """A line with a dot at its start."""
    count = int(np.ceil(np.abs(end - start).max())) + 1
    dot = start + np.array([[0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    points = np.concatenate([np.linspace(start, end, count), dot]).astype(int)
    inside = ((points >= 0) & (points < pixels.shape[:2])).all(axis=1)
    pixels[tuple(points[inside].T)] = _MARKER
