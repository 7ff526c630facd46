"""Which triangle a camera sees in each of its pixels."""

from __future__ import annotations

import math

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled

# A pixel on an edge belongs to the triangles on both sides, round-off included.
_EDGE = -1e-9


def _seen(
    points: Array, distance: Array, triangles: IntArray, rows: int, columns: int
) -> tuple[IntArray, Array]:
    centres = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1).reshape(
        -1, 2
    )
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    sides = np.linalg.inv(np.stack([b - a, c - a], axis=-1))
    inner = np.einsum("tij,tpj->pti", sides, centres - a[:, None])
    shares = np.concatenate([1.0 - inner.sum(axis=2, keepdims=True), inner], axis=2)
    away = np.where((shares >= _EDGE).all(axis=2), (shares * distance[triangles]).sum(axis=2), np.inf)
    nearest = away.argmin(axis=1)
    pixel = np.arange(len(centres))
    missed = np.isinf(away[pixel, nearest])
    found = np.where(missed, -1, nearest).reshape(rows, columns)
    return found, np.where(missed[:, None], 0.0, shares[pixel, nearest]).reshape(rows, columns, 3)


@compiled(reference=_seen)
def seen(
    points: Array, distance: Array, triangles: IntArray, rows: int, columns: int
) -> tuple[IntArray, Array]:
    """The nearest of triangles (t, 3) in each pixel: its index (rows, columns), -1 for none, and the barycentric
    coordinates (rows, columns, 3) of the pixel's centre. points: (n, 2) row and column, pixel centres being whole
    numbers; distance: (n,) from the camera."""
    found = np.full((rows, columns), -1)
    shares = np.zeros((rows, columns, 3))
    nearest = np.full((rows, columns), np.inf)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ay, ax = points[a, 0], points[a, 1]
        by, bx = points[b, 0] - ay, points[b, 1] - ax
        cy, cx = points[c, 0] - ay, points[c, 1] - ax
        area = by * cx - bx * cy
        if area == 0.0 or not math.isfinite(area):
            continue
        low_y, high_y = ay + min(0.0, by, cy), ay + max(0.0, by, cy)
        low_x, high_x = ax + min(0.0, bx, cx), ax + max(0.0, bx, cx)
        # Beyond the picture nothing is drawn, however far a triangle reaches.
        first_i, last_i = math.ceil(max(low_y - 1e-6, 0.0)), math.floor(min(high_y + 1e-6, rows - 1.0))
        first_j, last_j = math.ceil(max(low_x - 1e-6, 0.0)), math.floor(min(high_x + 1e-6, columns - 1.0))
        for i in range(first_i, last_i + 1):
            for j in range(first_j, last_j + 1):
                share_b = ((i - ay) * cx - (j - ax) * cy) / area
                share_c = ((j - ax) * by - (i - ay) * bx) / area
                share_a = 1.0 - share_b - share_c
                if min(share_a, share_b, share_c) < _EDGE:
                    continue
                away = share_a * distance[a] + share_b * distance[b] + share_c * distance[c]
                if away < nearest[i, j]:
                    nearest[i, j] = away
                    found[i, j] = t
                    shares[i, j, 0], shares[i, j, 1], shares[i, j, 2] = share_a, share_b, share_c
    return found, shares
