"""The nearest facet of every node of a grid, propagated from node to node: the kernels of `mesh_distance.py`.

Triangles are given by corners (t, 3, 3) in units of the grid's spacing, with its first node as the origin; node (i, j,
k) has the flat index (i n_1 + j) n_2 + k.
"""

from __future__ import annotations

import math

import igl
import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.compiled import compiled


@compiled
def _length(a: Array, b: Array) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled
def mark_near(corners: Array, shape: IntArray, marked: BoolArray) -> None:
    """Set marked (n_0 n_1 n_2,) at nodes within about a cell of the surface.

    Each triangle is sampled every half cell, along its longest side and across it, and the 4 x 4 x 4 nodes around each
    sample are marked.
    """
    for t in range(len(corners)):
        a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
        for _ in range(2):  # until ab is the longest side
            if _length(a, b) < max(_length(b, c), _length(c, a)):
                a, b, c = b, c, a
        along = int(2.0 * _length(a, b)) + 1
        middle = 0.5 * (a + b)
        across = int(2.0 * _length(middle, c)) + 1
        for m in range(across + 1):
            s = m / across
            steps = int((1.0 - s) * along) + 1
            for n in range(steps + 1):
                r = (1.0 - s) * n / steps
                first = np.empty(3, dtype=np.int64)
                for axis in range(3):
                    place = a[axis] + r * (b[axis] - a[axis]) + s * (c[axis] - a[axis])
                    first[axis] = math.floor(place) - 1
                for i in range(max(first[0], 0), min(first[0] + 4, shape[0])):
                    for j in range(max(first[1], 0), min(first[1] + 4, shape[1])):
                        for k in range(max(first[2], 0), min(first[2] + 4, shape[2])):
                            marked[(i * shape[1] + j) * shape[2] + k] = True


def _by_igl(t: Array, x: float, y: float, z: float) -> float:
    return float(igl.point_mesh_squared_distance(np.array([[x, y, z]]), t, np.array([[0, 1, 2]]))[0][0])


@compiled(reference=_by_igl)
def _squared_distance(t: Array, x: float, y: float, z: float) -> float:
    """Squared distance of the point (x, y, z) from a triangle t (3, 3) with corners a, b, c (Ericson 2004, section
    5.1.5)."""
    ax, ay, az = x - t[0, 0], y - t[0, 1], z - t[0, 2]
    ux, uy, uz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    vx, vy, vz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    d1, d2 = ux * ax + uy * ay + uz * az, vx * ax + vy * ay + vz * az
    d3, d4, d5, d6 = d1 - uu, d2 - uv, d1 - uv, d2 - vv  # the same from b and from c
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        r, s = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        r, s = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        r, s = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        r, s = d1 / uu, 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        r, s = 0.0, d2 / vv
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        s = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        r = 1.0 - s
    else:
        whole = va + vb + vc
        r, s = vb / whole, vc / whole
    px, py, pz = ax - r * ux - s * vx, ay - r * uy - s * vy, az - r * uz - s * vz
    return px * px + py * py + pz * pz


@compiled
def _descend(
    corners: Array,
    around: IntArray,
    starts: IntArray,
    facet: int,
    squared: float,
    x: float,
    y: float,
    z: float,
) -> tuple[float, int]:
    """Squared distance and index of the facet that a descent over neighbouring facets ends at."""
    while True:
        start = facet
        for at in range(starts[start], starts[start + 1]):
            distance = _squared_distance(corners[around[at]], x, y, z)
            if distance < squared:
                squared, facet = distance, around[at]
        if facet == start:
            return squared, facet


@compiled
def sweep(
    corners: Array,
    around: IntArray,
    starts: IntArray,
    shape: IntArray,
    fixed: BoolArray,
    squared: Array,
    facet: IntArray,
) -> None:
    """Propagate the nearest facets (n,) of the fixed nodes to the others: eight sweeps, one from each corner of the
    grid.

    A node takes the facet of one of the seven nodes behind it if it is nearer than its own, and descends from there
    over neighbouring facets as long as the distance decreases. squared (n,): the squared distance [cells^2]; both are
    filled in where not fixed.
    """
    n0, n1, n2 = shape
    for direction in range(8):
        di, dj, dk = 1 - 2 * (direction & 1), 1 - (direction & 2), 1 - (direction & 4) // 2
        for ii in range(n0):
            i = ii if di > 0 else n0 - 1 - ii
            for jj in range(n1):
                j = jj if dj > 0 else n1 - 1 - jj
                for kk in range(n2):
                    k = kk if dk > 0 else n2 - 1 - kk
                    node = (i * n1 + j) * n2 + k
                    if fixed[node]:
                        continue
                    best, own = squared[node], facet[node]
                    for behind in range(1, 8):
                        i_b, j_b, k_b = (
                            i - di * (behind & 1),
                            j - dj * (behind >> 1 & 1),
                            k - dk * (behind >> 2),
                        )
                        if not (0 <= i_b < n0 and 0 <= j_b < n1 and 0 <= k_b < n2):
                            continue
                        other = facet[(i_b * n1 + j_b) * n2 + k_b]
                        if other < 0 or other == own:
                            continue
                        distance = _squared_distance(corners[other], float(i), float(j), float(k))
                        if distance < best:
                            best, own = distance, other
                    if own != facet[node]:
                        squared[node], facet[node] = _descend(
                            corners, around, starts, own, best, float(i), float(j), float(k)
                        )
