"""The nearest point of a deformed surface: its facet, its place there, and on which side of it a point is.

Facets are searched in groups of neighbours, each in a ball about their nodes, so that most are not looked at. Points
that may be far from all facets are looked at in groups first, too.
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
# A facet whose angle has a squared sine of no more than this has no area but round-off.
_FLAT = 1e-12


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

    def nearest(
        self, points: Array, x: Array, near: IntArray | None = None, beyond: float = np.inf
    ) -> NearestFacets:
        """For points (m, dim) [m], with the nodes at x (n_nodes, dim) [m]. Where the nearest point is on an edge or a
        corner, the side is that of the pseudonormal of Baerentzen and Aanaes (2005), which is right for any closed
        surface. near: (m,) facets that are probably near the points, which makes the search faster; beyond: see
        `nearest_of`."""
        first = np.full(len(points), -1) if near is None else self._number[near]
        balls, single = bounding_balls(x, self._facets), np.arange(len(points) + 1)
        facet, weights, depth = _nearest(points, single, first, x, self._facets, *balls, self._starts, beyond)
        return NearestFacets(self._order[facet], weights, depth)


def nearest_of(
    points: Array,
    x: Array,
    facets: IntArray,
    groups: tuple[IntArray, IntArray] | None = None,
    beyond: float = np.inf,
) -> NearestFacets:
    """`SurfaceSearch.nearest` for facets (f, dim) that are searched once. groups: (f,) of the middles of the facets,
    and (m,) of the points, both ascending, see `grouped_by_place`; without them all facets are looked at for each
    point. beyond: for points farther outside than this [m], any facet nearby will do; their depth is then the distance
    from that, or less, negative, and also less than -beyond."""
    of_facets, of_points = groups or (np.zeros(len(facets)), np.arange(len(points)))
    begin, balls = np.full(len(points), -1), bounding_balls(x, facets)
    return NearestFacets(
        *_nearest(points, _starts(of_points), begin, x, facets, *balls, _starts(of_facets), beyond)
    )


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
    point_starts: IntArray,
    first: IntArray,
    x: Array,
    facets: IntArray,
    centre: Array,
    radius: Array,
    starts: IntArray,
    beyond: float,
) -> tuple[IntArray, Array, Array]:
    """The facet (m,), weights (m, dim) and depth (m,) of points (m, dim), of which group k has those from
    point_starts[k] to point_starts[k + 1]. first: (m,) facets near them, or -1; centre (f, dim) and radius (f,) of
    balls about the facets (f, dim), in groups like the points; beyond: see `nearest_of`."""
    m, dim = points.shape
    found, weights, depth = np.zeros(m, dtype=np.int64), np.zeros((m, dim)), np.empty(m)
    group_centre, group_radius = _group_balls(centre, radius, starts)
    middle, around = _group_balls(points, np.zeros(m), point_starts)
    trial, square_to = np.empty(dim), np.empty(len(group_centre))
    for k in range(len(middle)):
        own, end = point_starts[k], point_starts[k + 1]
        if end > own + 1 and beyond < math.inf:
            p, distance = middle[k], beyond + around[k]
            begin = _begin(p, group_centre, square_to, starts, centre)
            if _all_farther(p, x, facets, square_to, group_radius, starts, centre, radius, distance, trial):
                reach = math.sqrt(_closest(p, x, facets[begin], trial))
                if _along_normal(p, x, facets[begin], trial) > _OPPOSITE * reach:
                    # All points of the group are on the same side.
                    for i in range(own, end):
                        found[i], weights[i], depth[i] = begin, trial, around[k] - reach
                    continue
        for i in range(own, end):
            p, begin = points[i], first[i]
            if begin < 0:
                begin = _begin(p, group_centre, square_to, starts, centre)
            else:
                _squared_distances(p, group_centre, square_to)
            if _all_farther(p, x, facets, square_to, group_radius, starts, centre, radius, beyond, trial):
                reach = math.sqrt(_closest(p, x, facets[begin], weights[i]))
                if _along_normal(p, x, facets[begin], weights[i]) > _OPPOSITE * reach:
                    found[i], depth[i] = begin, -reach
                    continue
            found[i], height = _search(
                p, begin, x, facets, centre, radius, starts, group_radius, square_to, weights[i], trial
            )
            depth[i] = -height
    return found, weights, depth


@compiled
def _search(
    p: Array,
    begin: int,
    x: Array,
    facets: IntArray,
    centre: Array,
    radius: Array,
    starts: IntArray,
    group_radius: Array,
    squares: Array,
    weights: Array,
    trial: Array,
) -> tuple[int, float]:
    """The facet nearest to p (dim,) and the height of p above it. begin: one near p; squares: of the distances of p
    from the groups; weights: (dim,) written; trial: (dim,) for scratch."""
    least = _closest(p, x, facets[begin], weights) * (1.0 + 2.0 * _EQUAL)
    found, reach, side = begin, math.sqrt(least), 0.0
    for g in range(len(squares)):
        if squares[g] > (reach + group_radius[g]) ** 2:
            continue
        for f in range(starts[g], starts[g + 1]):
            if _farther(p, centre, f, reach + radius[f]):
                continue
            square = _closest(p, x, facets[f], trial)
            if square > least * (1.0 + _EQUAL):
                continue
            if square < least * (1.0 - _EQUAL):
                found, least, side = f, square, 0.0
                weights[:] = trial
                reach = math.sqrt(least) * (1.0 + _EQUAL)
            side += _angle(x, facets[f], trial) * _along_normal(p, x, facets[f], trial)
    return found, math.copysign(math.sqrt(least), side)


@compiled
def _begin(p: Array, group_centre: Array, squares: Array, starts: IntArray, centre: Array) -> int:
    """A facet near p (dim,). squares: of its distances from the groups, written."""
    nearest = _squared_distances(p, group_centre, squares)
    return _nearest_place(p, centre, starts[nearest], starts[nearest + 1])


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
    x: Array,
    facets: IntArray,
    squares: Array,
    group_radius: Array,
    starts: IntArray,
    centre: Array,
    radius: Array,
    distance: float,
    trial: Array,
) -> bool:
    """Whether p (dim,) is farther than a distance from all facets. squares: its squared distances from the groups;
    trial: (dim,) for scratch."""
    for g in range(len(squares)):
        if squares[g] > (distance + group_radius[g]) ** 2:
            continue
        for f in range(starts[g], starts[g + 1]):
            if _farther(p, centre, f, distance + radius[f]):
                continue
            if _closest(p, x, facets[f], trial) <= distance * distance:
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
    if uu * vv - uv * uv <= _FLAT * uu * vv:
        return _closest_on_edges(p, x, facet, weights)
    # The region of the plane that p is above: of a corner, an edge or the inside (Ericson 2005, section 5.1.5), by u
    # and v times the ways from the other two corners.
    u1, v1, u2, v2 = ur - uu, vr - uv, ur - uv, vr - vv
    opposite_2, opposite_1, opposite_0 = ur * v1 - u1 * vr, u2 * vr - ur * v2, u1 * v2 - u2 * v1
    weights[:] = 0.0
    if ur <= 0.0 and vr <= 0.0:
        weights[0] = 1.0
    elif u1 >= 0.0 and v1 <= u1:
        weights[1] = 1.0
    elif v2 >= 0.0 and u2 <= v2:
        weights[2] = 1.0
    elif opposite_2 <= 0.0 and ur >= 0.0 and u1 <= 0.0:
        return _closest_on_edge(p, x, facet, 0, 1, weights)
    elif opposite_1 <= 0.0 and vr >= 0.0 and v2 <= 0.0:
        return _closest_on_edge(p, x, facet, 0, 2, weights)
    elif opposite_0 <= 0.0 and v1 >= u1 and u2 >= v2:
        return _closest_on_edge(p, x, facet, 1, 2, weights)
    else:
        area = opposite_0 + opposite_1 + opposite_2
        weights[0], weights[1], weights[2] = opposite_0 / area, opposite_1 / area, opposite_2 / area
    return _squared_distance(p, x, facet, weights)


@compiled
def _closest_on_edges(p: Array, x: Array, facet: IntArray, weights: Array) -> float:
    """`_closest` of a facet without area."""
    # The nearest edge is found first, so that nothing is allocated for its weights.
    nearest, least = 0, math.inf
    for k in range(3):
        square = _closest_on_edge(p, x, facet, k, (k + 1) % 3, weights)
        if square < least:
            nearest, least = k, square
    return _closest_on_edge(p, x, facet, nearest, (nearest + 1) % 3, weights)


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
    along = length = 0.0
    for a in range(len(p)):
        way = p[a]
        for k in range(len(p)):
            way -= weights[k] * x[facet[k], a]
        if len(p) == 2:
            b = 1 - a
            normal = (1.0 - 2.0 * a) * (x[facet[1], b] - x[facet[0], b])
        else:
            b, c = (a + 1) % 3, (a + 2) % 3
            normal = (x[facet[1], b] - x[facet[0], b]) * (x[facet[2], c] - x[facet[0], c]) - (
                x[facet[1], c] - x[facet[0], c]
            ) * (x[facet[2], b] - x[facet[0], b])
        along += normal * way
        length += normal * normal
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
