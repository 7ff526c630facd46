"""Write a series of deformed bodies to a folder: a .vtu for each body and its colliders, and one .pvd."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.level_set import collider_surface
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.fields.deformed import Deformed, fields_of
from softprint.runtime.fields.vtu import write_collection, write_fields, write_surface


def write_series(
    folder: Path,
    name: str,
    body: ReducedBody,
    contact: PenaltyContact,
    series: Iterable[Deformed],
    progress: Callable[[int], None] = lambda n: None,
) -> Path:
    """Write ``folder``/``name``.pvd and the files it names, in ``folder``/``name``/; returns the .pvd.

    Files of an earlier series that are not part of this one are kept, but the .pvd no longer names them.
    """
    parts: list[tuple[float, str, Path]] = []
    surfaces: dict[str, tuple[Array, IntArray]] = {}
    for deformed in series:
        path = folder / name / f"{deformed.label}.vtu"
        write_fields(path, fields_of(body, contact, deformed))
        parts.append((deformed.time, "body", path))
        for collider, pose in deformed.colliders:
            if not np.isfinite(collider.upper - collider.lower).all():  # a plane: nothing to draw
                continue
            if collider.name not in surfaces:
                surfaces[collider.name] = collider_surface(collider)
            vertices, facets = surfaces[collider.name]
            path = folder / name / f"{deformed.label}_{collider.name}.vtu"
            write_surface(path, pose.apply(vertices), facets)
            parts.append((deformed.time, collider.name, path))
        progress(1)
    collection = folder / f"{name}.pvd"
    write_collection(collection, parts)
    return collection
