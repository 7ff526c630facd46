"""What a triangle mesh has to be mended of to be a collider, the mended surface, and what was done to it."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import igl
import numpy as np

from runtime.arrays import Array, IntArray
from runtime.colliders import repair
from runtime.colliders.rebuild import deviation, misplaced, rebuilt_surface
from runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class Examined:
    """What stands in a file and what becomes of it.

    found: label -> number; done: what was mended, a sentence each; refusal: why an experiment should not take the mesh
    as it is, empty if it may; vertices (v, 3), triangles (t, 3): the mended surface.
    """

    found: dict[str, Any]
    done: list[str]
    refusal: str
    vertices: Array
    triangles: IntArray


def examine(vertices: Array, triangles: IntArray, source: str) -> Examined:
    """Mend a mesh as a collider is (`repair.py`); where that is refused or leaves overlaps, rebuild it (`rebuild.py`).

    Raises SoftprintError where neither can be.
    """
    if not np.isfinite(vertices).all() or len(triangles) == 0:
        repair.closed_surface(vertices, triangles, source)  # which says so
    found = _found(vertices, triangles)
    with _told(source) as done:
        try:
            closed = repair.closed_surface(vertices, triangles, source)
            buried = int(misplaced(*closed).sum())
            found["overlapping or buried faces"] = buried
            refusal = f"{buried} of its faces lie within it or pass through others" if buried else ""
        except SoftprintError as error:
            refusal = str(error).removeprefix(f"{source}: ")
    if not refusal:
        return Examined(found, _counted(done), "", *closed)
    new = rebuilt_surface(*_merged(vertices, triangles, source), source)
    closed = repair.closed_surface(new.vertices, new.triangles, source)
    apart = deviation(vertices, triangles, closed)
    middle, most = np.quantile(apart, [0.5, 0.95])
    rebuilt = (
        f"rebuilt the surface from winding numbers on a grid of {new.spacing:.3g}: half of the file's triangles lie "
        f"within {middle:.2g} of it, 95 % within {most:.2g}"
    )
    return Examined(found, [rebuilt], refusal, *closed)


def _counted(sentences: list[str]) -> list[str]:
    """Each sentence once, with how often it was said."""
    return [f"{said} ({times} times)" if times > 1 else said for said, times in Counter(sentences).items()]


def _merged(vertices: Array, triangles: IntArray, source: str) -> tuple[Array, IntArray]:
    """What winding numbers are taken of: each triangle once, and neighbours facing the same way."""
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    with _told(source):  # it is rebuilt anyway
        vertices, triangles = repair.merge(vertices, triangles, diagonal, source)
        triangles = repair.drop_degenerate(vertices, triangles, diagonal, source)
    return vertices, np.asarray(igl.bfs_orient(triangles)[0], dtype=np.int64)


def _found(vertices: Array, triangles: IntArray) -> dict[str, Any]:
    """Counts of what is wrong with the triangles, vertices at one place taken for one."""
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
def _told(source: str) -> Iterator[list[str]]:
    """What the repairs would log, in a list instead."""
    told: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            told.append(record.getMessage().removeprefix(f"{source}: "))

    listener = Listener(logging.INFO)
    level, propagate = repair.log.level, repair.log.propagate
    repair.log.addHandler(listener)
    repair.log.setLevel(logging.INFO)
    repair.log.propagate = False
    try:
        yield told
    finally:
        repair.log.removeHandler(listener)
        repair.log.setLevel(level)
        repair.log.propagate = propagate
