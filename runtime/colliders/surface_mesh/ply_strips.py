"""Triangle strips in PLY files, as of the Stanford scans: lists of vertices in which every three in a row are a
triangle, cut by -1."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, IntArray


def read_ply_strips(path: Path) -> tuple[Array, IntArray]:
    """Vertices (v, 3) and triangles (t, 3) of the strips of a PLY file; no triangles where it has no strips."""
    import trimesh

    cloud: Any = trimesh.load(path, process=False)
    data = cloud.metadata.get("_ply_raw", {}).get("tristrips", {}).get("data")
    if data is None:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    table = np.asarray(data["vertex_indices"])
    # In a binary file each list is read with its length.
    lists = table["f1"] if table.dtype.names else table
    strips = [strip for row in lists for strip in _cut(np.asarray(row)) if len(strip) >= 3]
    triangles = np.asarray(trimesh.util.triangle_strips_to_faces(strips), dtype=np.int64)
    # A strip turns a corner by repeating a vertex: such triangles are flat.
    flat = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
    return np.asarray(cloud.vertices, dtype=float), triangles[~flat]


def _cut(row: IntArray) -> list[IntArray]:
    """The strips between the -1 of a list."""
    parts = np.split(row, np.flatnonzero(row < 0))
    return [part[part >= 0] for part in parts]
