"""Whether a collider has pierced the surface of a reduced body: found without the contact law, in every step.

Contact acts at points of the body's surface, and a collider can pass between them, or be pressed farther than the body
gives way. Points on the collider's surface are therefore compared with the nearest contact points of the deformed
surface: one on the inner side of its nearest point is at most as deep in the body as it is far from that point. Where
that is more than the limit, the depth of the deepest is found under the facets of the surface, as contact displaces
them, and with it that of points on the outer side of their nearest point, as the surface may have folded over. A body
thinner than twice the limit can be passed unseen. `intrusion.py` has the exact depth, from all cells of the body.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, Protocol

import igl
import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.colliders.surface_points import POINTS_ALONG, surface_points
from softprint.runtime.contact.piercing_kernels import bounds, farther_from_all, in_box, nearest_points
from softprint.runtime.mesh.nearest_facets import grouped_by_place, nearest_of

# A collider pierces the body from this depth on, in distances between contact points. Where a dent stretches the
# surface to twice its length, a collider point that touches it is up to 1.4 distances from the nearest of them, so that
# few are looked at more closely in ordinary contact.
_LIMIT = 2.0**0.5
# A collider that moves freely is held where its points are farther from the nearest contact points than so many
# distances between contact nodes: there the surface is stretched so much that the next step may lose the contact.
_HELD = 2.0
# At least so many points along the longest side of a collider.
_LEAST_ALONG = 8
# Of the collider points that seem to be deeper than the limit, so many are compared with all nodes ...
_FAR_POINTS = 64
# ... and so many of the deepest with the facets, of the others inside, and of those that seem to be outside: where a
# dent has stretched facets to many times their length, the point that is the deepest under them may be nearer to a node
# than most.
_DEEPEST, _OTHERS = 16, 48


class DeformedSurface(Protocol):
    """The contact points of a body at a state."""

    @property
    def known(self) -> Array:
        """Positions (k, dim) [m] of those that are known already, like those that bear force."""
        ...

    @property
    def approximate(self) -> Array:
        """Their positions (n, dim) [m], without the displacement by contact."""
        ...

    def positions(self, index: IntArray) -> Array:
        """Positions (m, dim) [m] of some of them (m,)."""
        ...

    def normals(self, index: IntArray) -> Array:
        """Outward normals (m, dim), of any length."""
        ...

    def depths(self, z: Array, near: IntArray, outer: BoolArray) -> Array:
        """How deep points z (k, dim) are inside the surface [m] (k,), negative outside. near: (m,) contact points to
        the facets beside which the distance is; outer: (k,) see `depths_inside`."""
        ...


@dataclass(frozen=True, eq=False)
class Piercing:
    """A collider inside a body. depth: of its deepest point [m]; point: where that is (dim,) [m]; refused: whether it
    would be there, in an iterate that was refused."""

    collider: str
    depth: float
    point: Array
    refused: bool = False

    @property
    def sentence(self) -> str:
        """Which collider is how deep inside, and where."""
        where = ", ".join(f"{1e3 * x:.1f}" for x in self.point)
        be = "would be" if self.refused else "is"
        return f"collider {self.collider!r} {be} {1e3 * self.depth:.1f} mm deep inside the body at ({where}) mm"


class PiercingSearch:
    """Finds colliders, by name, that have pierced a body whose contact points are `spacing` [m] apart, between nodes
    that are `node_spacing` [m] apart, by default as far."""

    def __init__(
        self, colliders: Mapping[str, Collider], spacing: float, node_spacing: float | None = None
    ) -> None:
        self.limit = _LIMIT * spacing
        self._held = _HELD * (spacing if node_spacing is None else node_spacing)
        self._probes = {name: _Probe.of(collider, spacing) for name, collider in colliders.items()}

    @property
    def names(self) -> list[str]:
        """The names of the colliders."""
        return list(self._probes)

    @property
    def bounded(self) -> list[str]:
        """The names of the colliders that have bounds."""
        return [name for name, probe in self._probes.items() if len(probe.points)]

    def found(self, surface: DeformedSurface, poses: Poses) -> dict[str, Piercing]:
        """Those of the colliders with poses that have pierced the surface."""
        return _without_none({name: self._inside(name, surface, pose) for name, pose in poses.items()})

    def too_far(self, surface: DeformedSurface, poses: Poses) -> dict[str, Piercing]:
        """Those of the colliders with poses that must be held, were they free; the depth is the distance from the
        nearest contact point, and the facets between them may be as deep."""
        found = {name: self._far_inside(name, surface, pose, self._held) for name, pose in poses.items()}
        return _without_none(
            {name: None if far is None else far.deepest(name) for name, far in found.items()}
        )

    def hops(self, name: str, before: RigidPose, after: RigidPose) -> int:
        """In how many parts a motion must be cut, so that no point of the collider moves farther than the limit in any;
        1 for a collider without bounds."""
        probe = self._probes[name]
        if not len(probe.points):
            return 1
        corners = _corners(probe.lower, probe.upper)
        way = np.linalg.norm(after.apply(corners) - before.apply(corners), axis=1).max()
        return max(1, int(np.ceil(way / self.limit)))

    def _inside(self, name: str, surface: DeformedSurface, pose: RigidPose) -> Piercing | None:
        far = self._far_inside(name, surface, pose, self.limit)
        if far is None:
            return None
        of = _looked_at(far.depth)
        z, outer = far.points[of], far.depth[of] == 0.0
        below = far._replace(points=z, depth=surface.depths(z, far.near, outer))
        return below.deepest(name) if below.depth.max() > self.limit else None

    def _far_inside(
        self, name: str, surface: DeformedSurface, pose: RigidPose, limit: float
    ) -> _FarInside | None:
        """The points of a collider that are farther than the limit [m] from the points of the surface, if any of them
        are inside; None if none."""
        probe, x = self._probes[name], surface.approximate
        least, most = bounds(x)
        # A collider inside may have lifted the surface out of the box that it is in without contact.
        lower, upper = bounds(np.concatenate([x, surface.known]))
        lifted = float(max((least - lower).max(), (upper - most).max()))
        around = pose.apply(probe.points)
        index = in_box(around, lower, upper)
        around = around[index]
        # No point is deeper in the body than in the box about it.
        inner = in_box(around, lower + limit, upper - limit)
        index, z = index[inner], around[inner]
        if not len(z):
            return None
        # Nor deeper than it is far from any point of the surface: in ordinary contact that says enough.
        kept = farther_from_all(z, surface.known, limit)
        if not kept.any():
            return None
        # Contact may have moved nodes of the surface from anywhere along the collider to a point of it.
        lower, upper = bounds(around)
        near = in_box(x, lower - (limit + lifted), upper + (limit + lifted))
        y, normal = surface.positions(near), surface.normals(near)
        kept &= ~probe.are_outside(index, pose, y, normal, limit)
        z = z[kept]
        z = z[farther_from_all(z, y, limit)]
        if not len(z):
            return None
        distance, depth = _nearest_depths(z, y, normal)
        # They are farther than the limit from every node near the collider: another node may be nearer.
        far = np.flatnonzero((depth > 0.0) | np.isinf(distance))
        if len(far):
            everywhere = x.copy()
            everywhere[near] = y
            depth[far] = 0.0
            some, near = far[:: -(-len(far) // _FAR_POINTS)], np.arange(len(x))
            _, depth[some] = _nearest_depths(z[some], everywhere, surface.normals(near))
        if not (depth > limit).any():
            return None
        kept = (depth > limit) | (depth == 0.0)
        return _FarInside(z[kept], depth[kept], near)


def _nearest_depths(z: Array, y: Array, normal: Array) -> tuple[Array, Array]:
    """Distance (m,) of points z (m, dim) from the nearest of the surface points y (n, dim), and the same as a depth
    (m,): 0 for points on the outer side, to which the outward normal (n, dim) of the nearest surface point points.
    Without surface points all are infinitely far away."""
    if not len(y):
        return np.full(len(z), np.inf), np.zeros(len(z))
    axis = int(np.ptp(y, axis=0).argmax())
    nearest, distance = nearest_points(z, y, np.argsort(y[:, axis]), axis)
    inner = ((z - y[nearest]) * normal[nearest]).sum(axis=1) < 0.0
    return distance, np.where(inner, distance, 0.0)


class _FarInside(NamedTuple):
    """Points (k, dim) [m] of a collider of which some are inside a body, their depth (k,) [m], 0 for those on the outer
    side of the nearest contact point, and the contact points (m,) near the collider."""

    points: Array
    depth: Array
    near: IntArray

    def deepest(self, name: str) -> Piercing:
        deepest = int(np.argmax(self.depth))
        return Piercing(name, float(self.depth[deepest]), self.points[deepest])


def _looked_at(depth: Array) -> IntArray:
    """The numbers of the points that are compared with the facets, of k points with depth (k,): the deepest, and every
    so many of the others inside, and of those with none."""
    order = np.argsort(-depth, kind="stable")
    inside = int((depth > 0.0).sum())
    others, outer = order[_DEEPEST:inside], order[inside:]
    some = [of[:: max(1, -(-len(of) // _OTHERS))] for of in (others, outer)]
    return np.concatenate([order[: min(_DEEPEST, inside)], *some])


def _without_none(found: Mapping[str, Piercing | None]) -> dict[str, Piercing]:
    return {name: piercing for name, piercing in found.items() if piercing is not None}


def depths_inside(
    z: Array,
    x: Array,
    facets: IntArray,
    near: IntArray,
    outer: BoolArray | None = None,
    groups: IntArray | None = None,
) -> Array:
    """How deep points z (k, dim) are inside a closed surface with facets (f, dim) between nodes at x (n_nodes, dim) [m]
    (k,), negative outside: as far as they are from the facets between some of the nodes (m,), infinitely without any.
    Where the surface has folded over, the nearest of these may show its outer side to a point inside, whose winding
    number is not zero then; and that may be zero where a body is turned inside out. Either tells of a point inside.
    outer: (k,) points of which only the winding number tells, by default none: to which the nearest node shows its
    outer side. Where a surface touches itself their nearest facet may show its inner one. groups: (f,) of the facets,
    ascending, see `nearest_of`."""
    beside = np.zeros(len(x), dtype=bool)
    beside[near] = True
    of = np.flatnonzero(beside[facets].all(axis=1))
    together = None if groups is None else (groups[of], np.arange(len(z)))
    depth = nearest_of(z, x, facets[of], together).depth if len(of) else np.full(len(z), np.inf)
    if outer is not None:
        depth[outer] = -np.abs(depth[outer])
    asked = np.flatnonzero(depth < 0.0)
    if len(asked):
        turns = igl.winding_number(x, facets.astype(np.int64), z[asked])
        depth[asked] *= np.where(np.rint(turns) != 0.0, -1.0, 1.0)
    return depth


@dataclass(frozen=True, eq=False)
class _Probe:
    """Points (m, dim) [m] on a collider's surface and the bounds (dim,) of the collider, in its own coordinates. A
    collider without bounds has no points: it is never inside a body. group: (m,) of neighbours; centre: (g, dim) and
    radius: (g,) [m] of balls about these."""

    points: Array
    lower: Array
    upper: Array
    group: IntArray
    centre: Array
    radius: Array

    @classmethod
    def of(cls, collider: Collider, spacing: float) -> _Probe:
        extent = float((collider.upper - collider.lower).max())
        finest, coarsest = extent / POINTS_ALONG[3], extent / _LEAST_ALONG
        apart = min(max(spacing, finest), coarsest) if np.isfinite(extent) else spacing
        points = surface_points(collider, apart)
        order, group = grouped_by_place(points)
        points, starts = points[order], np.flatnonzero(np.diff(group, prepend=-1))
        centre = np.add.reduceat(points, starts) / np.bincount(group)[:, None]
        radius = np.maximum.reduceat(np.linalg.norm(points - centre[group], axis=1), starts)
        return cls(points, collider.lower, collider.upper, group, centre, radius)

    def are_outside(
        self, index: IntArray, pose: RigidPose, y: Array, normal: Array, limit: float
    ) -> BoolArray:
        """Which of some points (k,) belong to a group on the outer side of surface points y (n, dim) with outward
        normals (n, dim): as their centre is, with no surface point nearer than the limit [m] to the ball about them."""
        outside = np.zeros(len(self.radius), dtype=bool)
        groups = np.unique(self.group[index])
        if len(y):
            distance, depth = _nearest_depths(pose.apply(self.centre[groups]), y, normal)
            outside[groups] = (depth == 0.0) & (distance > self.radius[groups] + limit)
        return outside[self.group[index]]


def _corners(lower: Array, upper: Array) -> Array:
    """(2^dim, dim) of a box."""
    return np.array(list(product(*zip(lower, upper, strict=True))))
