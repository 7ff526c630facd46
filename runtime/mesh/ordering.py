"""Renumber a mesh so that neighbours in space are neighbours in memory and in compressed files."""

from __future__ import annotations

import numpy as np

from softprint.runtime.mesh.check import oriented_mesh
from softprint.runtime.mesh.mesh import Mesh

_BITS = 10  # 1024 steps along each axis


def in_morton_order(mesh: Mesh) -> Mesh:
    """The same mesh, nodes numbered along a Morton (z-order) curve and cells sorted by their nodes."""
    steps = ((mesh.points - mesh.points.min(axis=0)) / mesh.size * (2**_BITS - 1)).astype(np.int64)
    code = sum(
        ((steps[:, axis] >> bit) & 1) << (mesh.dim * bit + axis)
        for axis in range(mesh.dim)
        for bit in range(_BITS)
    )
    order = np.argsort(code, kind="stable")
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    cells = np.sort(number[mesh.cells], axis=1)
    return oriented_mesh(mesh.points[order], cells[np.lexsort(cells.T[::-1])])
