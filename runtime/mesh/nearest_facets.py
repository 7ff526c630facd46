"""The nearest point of a deformed surface: its facet, its place there, and on which side of it a point is.

Facets are searched in groups of neighbours, each in a ball about their nodes, so that most are not looked at.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled
from softprint.runtime.mesh.simplex_kernels import bounding_balls

# At most so many facets in a group.
_GROUP = 32
# A point far from a surface is outside where its way from a facet nearby makes an angle with the outward normal that
# has at least this cosine.
_OPPOSITE = 0.5
# Points of facets whose squared distances differ by less than this share are the same: on a common edge or corner.
_EQUAL = 1e-9


class NearestFacets(NamedTuple):
    """Of m points: the facet (m,) with the nearest point of a surface, the barycentric coordinates of that (m, dim),
    zero at corners on which it does not depend, and the depth (m,) [m] below it, negative outside."""

    facet: IntArray
    weights: Array
    depth: Array


class SurfaceSearch:
    """The surface with facets (f, dim) between nodes that rest at `rest` (n_nodes, dim) [m]."""

    def __init__(self, rest: Array, facets: IntArray) -> None:
        self._order, group = grouped_by_place(rest[facets].mean(axis=1))
        self._starts = _starts(group)
        self._number = np.argsort(self._order)
        self._facets = np.ascontiguousarray(facets[self._order])

    def nearest(self, points: Array, x: Array, near: IntArray | None = None) -> NearestFacets:
        """For points (m, dim) [m], with the nodes at x (n_nodes, dim) [m]. Where the nearest point is on an edge or a
        corner, the side is that of the pseudonormal of Baerentzen and Aanaes (2005), which is right for any closed
        surface. near: (m,) facets that are probably near the points, which makes the search faster."""
        first = np.full(len(points), -1) if near is None else self._number[near]
        balls = bounding_balls(x, self._facets)
        facet, weights, depth = _nearest(points, first, x, self._facets, *balls, self._starts, np.inf)
        return NearestFacets(self._order[facet], weights, depth)


def nearest_of(
    points: Array, x: Array, facets: IntArray, group: IntArray | None = None, beyond: float = np.inf
) -> NearestFacets:
    """`SurfaceSearch.nearest` for facets (f, dim) that are searched once. group: (f,) ascending, of their middles, see
    `grouped_by_place`; without it all are looked at. beyond: for points farther outside than this [m], any facet nearby
    will do; their depth is then the distance from that, negative, and also less than -beyond."""
    begin, starts = np.full(len(points), -1), _starts(np.zeros(len(facets)) if group is None else group)
    return NearestFacets(*_nearest(points, begin, x, facets, *bounding_balls(x, facets), starts, beyond))


def grouped_by_place(places: Array) -> tuple[IntArray, IntArray]:
    """An order (n,) of places (n, dim) in which neighbours follow each other, and the group of each of these: some tens
    of neighbours."""
    groups = _groups(places, np.arange(len(places)))
    return np.concatenate(groups), np.repeat(np.arange(len(groups)), [len(own) for own in groups])


def _starts(group: Array | IntArray) -> IntArray:
    """Where each group of places (n,) begins, and n."""
    return np.append(np.flatnonzero(np.diff(group, prepend=-1)), len(group))


def _groups(centres: Array, index: IntArray) -> list[IntArray]:
    """Neighbouring facets together: halves along the longest side, and so on."""
    if len(index) <= _GROUP:
        return [index]
    own = centres[index]
    along = np.argsort(own[:, np.ptp(own, axis=0).argmax()], kind="stable")
    half = len(index) // 2
    return [*_groups(centres, index[along[:half]]), *_groups(centres, index[along[half:]])]


@compiled
def _nearest(
    points: Array,
    first: IntArray,
    x: Array,
    facets: IntArray,
    centre: Array,
    radius: Array,
    starts: IntArray,
    beyond: float,
) -> tuple[IntArray, Array, Array]:
    """The facet (m,), weights (m, dim) and depth (m,) of points (m, dim). first: (m,) facets near them, or -1; centre
    (f, dim) and radius (f,) of balls about the facets (f, dim), of which group g has those from starts[g] to
    starts[g + 1]; beyond: see `nearest_of`."""
    m, dim = points.shape
    found, weights, depth = np.zeros(m, dtype=np.int64), np.zeros((m, dim)), np.empty(m)
    group_centre, group_radius = _group_balls(centre, radius, starts)
    trial, square_to = np.empty(dim), np.empty(len(group_centre))
    for i in range(m):
        p, side = points[i], 0.0
        nearest = _squared_distances(p, group_centre, square_to)
        begin, far = first[i], False
        if begin < 0:
            begin = _nearest_place(p, centre, starts[nearest], starts[nearest + 1])
            far = _all_farther(p, square_to, group_radius, starts, centre, radius, beyond)
        least = _closest(p, x, facets[begin], trial) * (1.0 + 2.0 * _EQUAL)
        reach = math.sqrt(least)
        if far and _along_normal(p, x, facets[begin], trial) > _OPPOSITE * reach:
            found[i], weights[i], depth[i] = begin, trial, -reach
            continue
        for g in range(len(group_centre)):
            if square_to[g] > (reach + group_radius[g]) ** 2:
                continue
            for f in range(starts[g], starts[g + 1]):
                if _farther(p, centre, f, reach + radius[f]):
                    continue
                square = _closest(p, x, facets[f], trial)
                if square > least * (1.0 + _EQUAL):
                    continue
                if square < least * (1.0 - _EQUAL):
                    found[i], weights[i], least, side = f, trial, square, 0.0
                    reach = math.sqrt(least) * (1.0 + _EQUAL)
                side += _angle(x, facets[f], trial) * _along_normal(p, x, facets[f], trial)
        depth[i] = -math.copysign(math.sqrt(least), side)
    return found, weights, depth


@compiled
def _group_balls(centre: Array, radius: Array, starts: IntArray) -> tuple[Array, Array]:
    """Balls about groups of balls: centres (n, dim) and radii (n,)."""
    n, dim = len(starts) - 1, centre.shape[1]
    middle, reach = np.zeros((n, dim)), np.zeros(n)
    for g in range(n):
        for f in range(starts[g], starts[g + 1]):
            for a in range(dim):
                middle[g, a] += centre[f, a] / (starts[g + 1] - starts[g])
        for f in range(starts[g], starts[g + 1]):
            square = 0.0
            for a in range(dim):
                square += (centre[f, a] - middle[g, a]) ** 2
            reach[g] = max(reach[g], math.sqrt(square) + radius[f])
    return middle, reach


@compiled
def _squared_distances(p: Array, places: Array, squares: Array) -> int:
    """Those of places (n, dim) from p (dim,), written into `squares` (n,); the nearest place."""
    nearest = 0
    for k in range(len(places)):
        square = 0.0
        for a in range(len(p)):
            square += (p[a] - places[k, a]) ** 2
        squares[k] = square
        if square < squares[nearest]:
            nearest = k
    return nearest


@compiled
def _nearest_place(p: Array, places: Array, first: int, end: int) -> int:
    """The nearest to p (dim,) of the places (n, dim) from the first to before the end."""
    nearest, least = first, math.inf
    for k in range(first, end):
        square = 0.0
        for a in range(len(p)):
            square += (p[a] - places[k, a]) ** 2
        if square < least:
            nearest, least = k, square
    return nearest


@compiled
def _all_farther(
    p: Array,
    squares: Array,
    group_radius: Array,
    starts: IntArray,
    centre: Array,
    radius: Array,
    distance: float,
) -> bool:
    """Whether p (dim,) is farther than a distance from all facets. squares: its squared distances from the groups."""
    for g in range(len(squares)):
        if squares[g] > (distance + group_radius[g]) ** 2:
            continue
        for f in range(starts[g], starts[g + 1]):
            if not _farther(p, centre, f, distance + radius[f]):
                return False
    return True


@compiled
def _farther(p: Array, places: Array, k: int, distance: float) -> bool:
    """Whether p (dim,) is farther than a distance from place k."""
    square = 0.0
    for a in range(len(p)):
        square += (p[a] - places[k, a]) ** 2
    return square > distance * distance


@compiled
def _closest(p: Array, x: Array, facet: IntArray, weights: Array) -> float:
    """Barycentric coordinates (dim,), written into `weights`, of the point of a facet nearest to p (dim,), and its
    squared distance."""
    if len(facet) == 2:
        return _closest_on_edge(p, x, facet, 0, 1, weights)
    uu = uv = vv = ur = vr = 0.0
    for a in range(3):
        u, v, r = x[facet[1], a] - x[facet[0], a], x[facet[2], a] - x[facet[0], a], p[a] - x[facet[0], a]
        uu, uv, vv, ur, vr = uu + u * u, uv + u * v, vv + v * v, ur + u * r, vr + v * r
    area = uu * vv - uv * uv
    if area > 0.0:
        s, t = (vv * ur - uv * vr) / area, (uu * vr - uv * ur) / area
        if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
            weights[0], weights[1], weights[2] = 1.0 - s - t, s, t
            return _squared_distance(p, x, facet, weights)
    least, trial = math.inf, np.empty(3)
    for k in range(3):
        square = _closest_on_edge(p, x, facet, k, (k + 1) % 3, trial)
        if square < least:
            least = square
            weights[:] = trial
    return least


@compiled
def _closest_on_edge(p: Array, x: Array, facet: IntArray, i: int, j: int, weights: Array) -> float:
    along = length = 0.0
    for a in range(len(p)):
        edge = x[facet[j], a] - x[facet[i], a]
        along += edge * (p[a] - x[facet[i], a])
        length += edge * edge
    t = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    weights[:] = 0.0
    weights[i], weights[j] = 1.0 - t, t
    return _squared_distance(p, x, facet, weights)


@compiled
def _squared_distance(p: Array, x: Array, facet: IntArray, weights: Array) -> float:
    square = 0.0
    for a in range(len(p)):
        apart = p[a]
        for k in range(len(facet)):
            apart -= weights[k] * x[facet[k], a]
        square += apart * apart
    return square


@compiled
def _along_normal(p: Array, x: Array, facet: IntArray, weights: Array) -> float:
    """The component along the outward unit normal of the way from the point of a facet to p (dim,)."""
    dim = len(p)
    normal, way = np.empty(dim), np.empty(dim)
    for a in range(dim):
        way[a] = p[a]
        for k in range(dim):
            way[a] -= weights[k] * x[facet[k], a]
    if dim == 2:
        normal[0], normal[1] = x[facet[1], 1] - x[facet[0], 1], x[facet[0], 0] - x[facet[1], 0]
    else:
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            normal[a] = (x[facet[1], b] - x[facet[0], b]) * (x[facet[2], c] - x[facet[0], c]) - (
                x[facet[1], c] - x[facet[0], c]
            ) * (x[facet[2], b] - x[facet[0], b])
    along = length = 0.0
    for a in range(dim):
        along += normal[a] * way[a]
        length += normal[a] * normal[a]
    return along / math.sqrt(length) if length > 0.0 else 0.0


@compiled
def _angle(x: Array, facet: IntArray, weights: Array) -> float:
    """The weight of a facet in the pseudonormal: its angle at a corner; 1 on its edges and inside it."""
    if len(facet) == 2:
        return 1.0
    for k in range(3):
        if weights[k] == 1.0:
            uu = uv = vv = 0.0
            for a in range(3):
                u = x[facet[(k + 1) % 3], a] - x[facet[k], a]
                v = x[facet[(k + 2) % 3], a] - x[facet[k], a]
                uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
            if uu * vv == 0.0:
                return 0.0
            return math.acos(min(max(uv / math.sqrt(uu * vv), -1.0), 1.0))
    return 1.0
