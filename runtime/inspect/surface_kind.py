"""A triangle surface: a collider, or what a collider could be made of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.colliders.mesh_collider import SUFFIXES, read_surface
from runtime.colliders.repair import closed_surface
from runtime.drawing.colours import COLLIDER
from runtime.drawing.scene import Scene
from runtime.errors import SoftprintError
from runtime.inspect.file_head import FileHead
from runtime.inspect.kinds import Kind, Part
from runtime.inspect.mesh_quality import facet_edges
from runtime.inspect.summary import Summary
from runtime.mesh.mesh import facet_vectors


def recognise(head: FileHead) -> bool:
    return head.suffix in SUFFIXES


def summarise(path: Path, part: Part) -> Summary:
    """What stands in the file, and whether it can be a collider after the repairs that a collider gets."""
    vertices, triangles = read_surface(path)
    if not np.isfinite(vertices).all() or triangles.min() < 0 or triangles.max() >= len(vertices):
        raise SoftprintError(
            f"{path}: has vertices that are not numbers, or triangles of vertices that are not there"
        )
    area = np.linalg.norm(facet_vectors(vertices, triangles), axis=1)
    facts: dict[str, Any] = {
        "vertices in the file": len(vertices),
        "triangles": len(triangles),
        "extent": [float(length) for length in np.ptp(vertices, axis=0)],
        "area": float(area.sum()),
    }
    return Summary(
        path,
        "a triangle surface",
        {"surface, in the file's units": facts | _as_collider(path, vertices, triangles)},
    )


def _as_collider(path: Path, vertices: Array, triangles: IntArray) -> dict[str, Any]:
    try:
        merged, closed = closed_surface(vertices, triangles, path.name)
    except SoftprintError as error:
        return {"watertight": False, "as a collider": f"refused: {error}"}
    corners = merged[closed]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    return {
        "watertight": bool((facet_edges(closed) == 2).all()),
        "as a collider": "usable" if len(closed) == len(triangles) else "usable after repairs",
        "vertices, merged": len(np.unique(closed)),
        "volume": float(volume),
    }


def scene(path: Path, part: Part, experiment: Path | None) -> Scene:
    vertices, triangles = read_surface(path)
    return Scene(path.name, vertices, triangles, edges=True, colour=COLLIDER)


KIND = Kind(recognise, summarise, scene=scene)
