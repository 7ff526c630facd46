"""Check a triangle mesh as a collider: its defects, the repaired surface, and the repairs that were made."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import igl
import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.surface_mesh import repair
from softprint.runtime.colliders.surface_mesh.rebuild import CELLS, deviation, misplaced, rebuilt_surface
from softprint.runtime.errors import SoftprintError

# At most this share of the faces, or this many, are removed and their holes closed; else the surface is rebuilt.
_FEW, _FEW_FACES = 0.01, 10


@dataclass(frozen=True, eq=False)
class Examined:
    """The content of a mesh file and its repaired surface.

    found: label -> number; done: a sentence for each repair; refusal: why an experiment should not use the mesh as it
    is, empty if it may; vertices (v, 3), triangles (t, 3): the repaired surface; rebuilt: whether it is a new
    surface, by winding numbers.
    """

    found: dict[str, Any]
    done: list[str]
    refusal: str
    vertices: Array
    triangles: IntArray
    rebuilt: bool = False


def examine(vertices: Array, triangles: IntArray, source: str, cells: int = CELLS) -> Examined:
    """Repair a mesh as for a collider (`repair.py`). If that is refused or leaves overlaps, remove the faces at fault
    where they are few; otherwise rebuild the surface (`rebuild.py`).

    Raises SoftprintError if neither is possible, and for flat drawings.
    """
    if not np.isfinite(vertices).all() or len(triangles) == 0:
        repair.closed_surface(vertices, triangles, source)  # raises the error
    repair.refuse_flat(vertices, source)
    found = _found(vertices, triangles)
    with _collected_log(source) as done:
        try:
            closed = repair.closed_surface(vertices, triangles, source)
            buried = int(misplaced(*closed).sum())
            found["overlapping or buried faces"] = buried
            refusal = f"{buried} of its faces lie within it or pass through others" if buried else ""
        except SoftprintError as error:
            refusal = str(error).removeprefix(f"{source}: ")
    if not refusal:
        return Examined(found, _counted(done), "", *closed)
    mended = _mended(vertices, triangles, source)
    if mended is not None:
        return Examined(found, [mended.done], refusal, mended.vertices, mended.triangles)
    new = rebuilt_surface(*merged_triangles(vertices, triangles, source), source, cells)
    closed = repair.closed_surface(new.vertices, new.triangles, source)
    apart = deviation(vertices, triangles, closed)
    middle, most = np.quantile(apart, [0.5, 0.95])
    rebuilt = (
        f"rebuilt the surface from winding numbers on a grid of {new.spacing:.3g}: half of the file's triangles lie "
        f"within {middle:.2g} of it, 95 % within {most:.2g}"
    )
    return Examined(found, [rebuilt], refusal, *closed, rebuilt=True)


class _Mended(NamedTuple):
    """A sentence for what was done, and the surface."""

    done: str
    vertices: Array
    triangles: IntArray


def _mended(vertices: Array, triangles: IntArray, source: str) -> _Mended | None:
    """The surface without its few bad faces, the holes closed: None where that is not enough. All other faces stay as
    they are."""
    most = max(_FEW_FACES, int(_FEW * len(triangles)))
    with _collected_log(source):
        try:
            vertices, triangles = merged_triangles(vertices, triangles, source)
            before = len(triangles)
            good = triangles[~repair.at_shared_edges(triangles)]
            removed = before - len(good)
            if removed > most:
                return None
            closed = repair.closed_surface(vertices, good, source)
            bad = misplaced(*closed)
            if bad.any() and removed + bad.sum() <= most:
                removed += int(bad.sum())
                closed = repair.closed_surface(closed[0], closed[1][~bad], source)
        except SoftprintError:
            return None
    if misplaced(*closed).any():
        return None
    return _Mended(f"removed {removed} of {before} faces, and closed the holes that they left", *closed)


def _counted(sentences: list[str]) -> list[str]:
    """Each sentence once, with the number of repetitions."""
    return [
        f"{sentence} ({times} times)" if times > 1 else sentence
        for sentence, times in Counter(sentences).items()
    ]


def merged_triangles(vertices: Array, triangles: IntArray, source: str) -> tuple[Array, IntArray]:
    """Each vertex and each triangle once, neighbours consistently oriented: the input of winding numbers."""
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    with _collected_log(source):  # the log is not needed: the surface is rebuilt anyway
        vertices, triangles = repair.merge(vertices, triangles, diagonal, source)
        triangles = repair.drop_degenerate(vertices, triangles, diagonal, source)
    return vertices, np.asarray(igl.bfs_orient(triangles)[0], dtype=np.int64)


def _found(vertices: Array, triangles: IntArray) -> dict[str, Any]:
    """Counts of the defects of the triangles, after merging coincident vertices."""
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    merged, joined = repair.merge(vertices, triangles, diagonal, "the mesh")
    area = np.linalg.norm(np.cross(*(merged[joined[:, k]] - merged[joined[:, 0]] for k in (1, 2))), axis=1)
    distinct = len(np.unique(repair.corner_codes(joined)))
    _, counts = repair.edge_counts(joined)
    return {
        "vertices in the file": len(vertices),
        "vertices, merged": len(np.unique(joined)),
        "triangles": len(triangles),
        "separate pieces": int(np.max(igl.facet_components(joined)[1])) + 1,
        "repeated triangles": len(joined) - distinct,
        "degenerate triangles": int((area <= repair.DEGENERATE_HEIGHT * diagonal**2).sum()),
        "open edges": int((counts == 1).sum()),
        "edges of more than two triangles": int((counts > 2).sum()),
        "edges whose triangles face opposite ways": repair.repeated_directions(joined),
        "extent": [float(length) for length in np.ptp(vertices, axis=0)],
    }


@contextmanager
def _collected_log(source: str) -> Iterator[list[str]]:
    """Collect the log lines of the repairs in a list."""
    lines: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            lines.append(record.getMessage().removeprefix(f"{source}: "))

    listener = Listener(logging.INFO)
    level, propagate = repair.log.level, repair.log.propagate
    repair.log.addHandler(listener)
    repair.log.setLevel(logging.INFO)
    repair.log.propagate = False
    try:
        yield lines
    finally:
        repair.log.removeHandler(listener)
        repair.log.setLevel(level)
        repair.log.propagate = propagate
