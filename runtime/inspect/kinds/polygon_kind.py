"""The corners of a polygon collider, a text file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from softprint.runtime.colliders.sampled.polygon import load_polygon, polygon_collider
from softprint.runtime.drawing.scene import Scene
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary

_NUMBERS = re.compile(rb"(\s*#[^\n]*\n)*\s*[-+.\deE]+\s+[-+.\deE]+\s*\n")


def recognise(head: FileHead) -> bool:
    """Text that begins, after comments, with a line of two numbers."""
    return head.suffix in (".txt", ".xy", ".dat") and _NUMBERS.match(head.start) is not None


def summarise(path: Path, part: Part) -> Summary:
    """Checks it as the collider of an experiment."""
    corners = load_polygon(path)
    polygon_collider(corners, resolution=8, name=path.name)
    after = np.roll(corners, -1, axis=0)
    area = 0.5 * abs(np.sum(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]))
    facts = {
        "corners": len(corners),
        "extent": [float(length) for length in np.ptp(corners, axis=0)],
        "area": float(area),
        "as a collider": "usable",
    }
    return Summary(path, "a polygon", {"polygon, in the file's units": facts})


def scene(path: Path, part: Part, experiment: Path | None) -> Scene:
    corners = load_polygon(path)
    number = np.arange(len(corners))
    return Scene(path.name, corners, np.column_stack([number, np.roll(number, -1)]))


KIND = Kind(recognise, summarise, scene=scene)
