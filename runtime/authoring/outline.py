"""Read a 2D outline: closed loops of corners from an SVG, a DXF or a text file of two columns."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.sampled.polygon import load_polygon
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.memory_bound import memory_bound

OUTLINES = (".svg", ".dxf", ".txt")
_ON_A_CURVE = 24  # points of each curved segment
_CLOSED = 1e-6  # ends of a loop that are nearer than this share of its extent are one
MOST_CORNERS = 5000


def read_outline(path: Path) -> list[Array]:
    """Closed loops, each of corners (n, 2) in the file's unit, y up. Raises SoftprintError for files that hold none."""
    readers = {".svg": _svg, ".dxf": _dxf, ".txt": lambda file: [load_polygon(file)]}
    kind = path.suffix[1:].upper()
    try:
        with memory_bound(path):
            loops = readers[path.suffix.lower()](path)
    except SoftprintError:
        raise
    except Exception as error:  # the readers raise different exceptions for bad files
        raise SoftprintError(f"{path}: cannot be read as {kind}: {type(error).__name__}: {error}") from error
    loops = [_without_repeats(np.asarray(loop, dtype=float)) for loop in loops if len(loop)]
    loops = [loop for loop in loops if len(loop) >= 3]
    if not loops:
        raise SoftprintError(
            f"{path}: holds no closed outline; a body in the plane is drawn with closed paths or shapes"
        )
    corners = sum(map(len, loops))
    if corners > MOST_CORNERS:
        raise SoftprintError(
            f"{path}: has {corners} corners, and an outline at most {MOST_CORNERS}; simplify it"
        )
    if not all(np.isfinite(loop).all() for loop in loops):
        raise SoftprintError(f"{path}: has coordinates that are not finite numbers")
    return loops


def _svg(path: Path) -> list[Array]:
    """Paths and shapes, with their transforms. Units are those of the drawing's view box."""
    from svgelements import SVG, Close, Line, Move, Shape
    from svgelements import Path as Outline

    text = path.read_text(encoding="utf-8", errors="strict")
    if "<!ENTITY" in text:
        raise SoftprintError(f"{path}: defines entities of its own, which a drawing does not need")
    # The size of the page would scale the drawing to pixels.
    text = re.sub(r"(<svg\b[^>]*?)\s(?:width|height)=(\"[^\"]*\"|'[^']*')", r"\1", text, count=1)
    text = re.sub(r"(<svg\b[^>]*?)\s(?:width|height)=(\"[^\"]*\"|'[^']*')", r"\1", text, count=1)
    text = re.sub(r"(<svg\b[^>]*?)\sviewBox=(\"[^\"]*\"|'[^']*')", r"\1", text, count=1)
    loops: list[Array] = []
    for element in SVG.parse(io.StringIO(text), reify=True).elements():
        if not isinstance(element, Shape):
            continue
        for part in Outline(element).as_subpaths():
            corners: list[complex] = []
            closed = False
            for segment in Outline(part):
                closed |= isinstance(segment, Close)
                if isinstance(segment, Move | Line | Close):
                    ends = [segment.end]
                else:
                    ends = [segment.point(t) for t in np.linspace(0.0, 1.0, _ON_A_CURVE + 1)[1:]]
                corners += [complex(end.x, -end.y) for end in ends if end is not None]  # y is down in SVG
            loop = np.array([[corner.real, corner.imag] for corner in corners]).reshape(-1, 2)
            if closed or (len(loop) > 3 and _meets_itself(loop)):
                loops.append(loop)
    return loops


def _dxf(path: Path) -> list[Array]:
    """Closed paths of a drawing, through trimesh."""
    import trimesh

    drawing = trimesh.load_path(path)
    return [
        np.asarray(loop)[:, :2]
        for loop in drawing.discrete
        if len(loop) > 3 and _meets_itself(np.asarray(loop))
    ]


def _meets_itself(loop: Array) -> bool:
    """Whether it ends where it begins."""
    return bool(
        np.linalg.norm(loop[0] - loop[-1]) <= _CLOSED * max(float(np.ptp(loop, axis=0).max()), 1e-300)
    )


def _without_repeats(loop: Array) -> Array:
    """Corners that differ from the one before, the last from the first."""
    with np.errstate(over="ignore", invalid="ignore"):
        least = _CLOSED * float(np.ptp(loop, axis=0).max())
        apart = np.linalg.norm(loop - np.roll(loop, 1, axis=0), axis=1)
    return loop[~(apart <= least)]
