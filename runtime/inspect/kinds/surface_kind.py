"""A triangle surface: a collider, or a candidate for one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.surface_mesh.mesh_collider import SUFFIXES, read_surface
from softprint.runtime.colliders.surface_mesh.repair import closed_surface
from softprint.runtime.drawing.colours import COLLIDER
from softprint.runtime.drawing.scene import Scene
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.mesh_quality import facet_edges
from softprint.runtime.inspect.summary import Summary
from softprint.runtime.mesh.mesh import facet_vectors


def recognise(head: FileHead) -> bool:
    return head.suffix in SUFFIXES


def summarise(path: Path, part: Part) -> Summary:
    """The content of the file, and whether it can be a collider after the usual repairs."""
    vertices, triangles = read_surface(path)
    if not np.isfinite(vertices).all() or triangles.min() < 0 or triangles.max() >= len(vertices):
        raise SoftprintError(
            f"{path}: has vertices that are not numbers, or triangles of vertices that do not exist"
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
