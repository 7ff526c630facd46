"""Moves a collider along a line to an exact depth below a surface.

The collider's origin moves on the line p + s n, inward as s decreases, with fixed rotation. Its depth below the points
x_i of the surface is -min_i sdf(R^T (x_i - p - s n)). The result is the *first* pose, coming from outside, at which the
depth is reached. A signed distance has slope at most one, so steps no longer than the remaining distance cannot jump
over it (sphere tracing); a bracketing root finder does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose

# Tolerance of the root finder and shortest marching step, relative to the collider's size. The first is the accuracy of
# every depth; the second only bounds how far the march may overstep before the root is bracketed.
_EXACT = 1e-12
_SHORTEST_STEP = 1e-3
# The thickness is found in steps relative to the collider's size; the depth has stopped growing if it increases by less
# than a share of the step.
_THICKNESS_STEP, _STILL_GROWING = 0.01, 0.2
# A node that a corner grazes at less than this share of the requested depth is ignored in measuring the thickness.
_GRAZE = 0.1


# Points at which the line of approach is looked for in the collider.
_ALONG_THE_LINE = 400


class OutOfReach(Exception):
    """The collider cannot reach the depth on this line; the message is recorded in the file."""


@dataclass(frozen=True, eq=False)
class Approach:
    """A line of approach to a surface.

    surface: (n, dim) points [m]: nodes, and points between them where contact is on facets; place: (dim,) the point
    aimed at [m]; normal: (dim,) unit outward normal there; rotation: (dim, dim) of the collider.
    """

    collider: Collider
    surface: Array
    place: Array
    normal: Array
    rotation: Array

    def pose(self, s: float) -> RigidPose:
        """The collider's pose with its origin at place + s normal."""
        return RigidPose(self.rotation, self.place + s * self.normal)

    def depth(self, s: float) -> float:
        """Depth of the collider's deepest point below the surface [m]; negative without contact."""
        return -float(self.collider.sdf(self.pose(s).apply_inverse(self.surface)).min())

    def poses_at(self, depths: Array) -> list[RigidPose]:
        """Poses at ascending depths (k,) [m]; each is the first on the path inward with that depth.

        Raises OutOfReach if a depth is more than collider and body allow on this line.
        """
        s = self.clear_of_surface
        poses = []
        for depth in depths:
            s = self._march(s, float(depth))
            poses.append(self.pose(s))
        return poses

    def sensible(self, depth: float) -> float:
        """The depth [m], limited by the collider's thickness where it enters."""
        return min(depth, self.thickness(depth))

    def thickness(self, depth: float) -> float:
        """How deep a point of the surface can be in the collider where it enters [m]; infinite where that is at least
        `depth` [m].

        Nodes nearer to the far side of a wall, a rim or a prong than to the side that met them would be pushed out on
        the far side: their signed distance no longer gives the penetration. On the path inward the depth then stops
        growing, and that is the limit.
        """
        step = _THICKNESS_STEP * self._length
        s, reached = self.clear_of_surface, -np.inf
        lowest = s - 4.0 * self._radius
        deepest = self._deepest
        while reached < depth and s > lowest:
            before, s = reached, s - max(-reached if np.isfinite(reached) else 0.0, step)
            reached = deepest.depth(s)
            if before > _GRAZE * depth and reached < before + _STILL_GROWING * step:
                return before
        return np.inf

    def meets(self, points: Array, deepest: float) -> float:
        """The depth [m] at which the collider begins to touch some of points (k, dim) [m] of the surface; infinite if
        it has touched none of them when it is at the deepest [m], or never gets so deep."""
        if not len(points):
            return np.inf
        to_points = replace(self, surface=points)
        try:
            end = self._march(self.clear_of_surface, deepest)
            return self.depth(to_points._march(to_points.clear_of_surface, 0.0, end))
        except OutOfReach:
            return np.inf

    def reached_on_the_way(self, centres: Array, radii: Array, depth: float) -> BoolArray:
        """(k,) which balls with centres (k, dim) and radii (k,) [m] the box about the collider touches on its way to a
        depth [m]: the slabs of the box, each as wide as the ball is large, are passed in an interval of s."""
        try:
            end = self._march(self.clear_of_surface, depth)
        except OutOfReach:
            end = -np.inf
        at, along = (centres - self.place) @ self.rotation, self.normal @ self.rotation
        lower, upper = at - self.collider.upper - radii[:, None], at - self.collider.lower + radii[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):  # along a slab: all s, or none
            slabs = np.sort([lower / along, upper / along], axis=0)
        first, last = np.maximum(slabs[0].max(axis=1), end), slabs[1].min(axis=1)
        return np.asarray(first <= last)

    @cached_property
    def _length(self) -> float:
        """A common length of the collider and the surface; half spaces have no size of their own."""
        extent = float(np.ptp(self.surface, axis=0).max())
        return min(self.collider.size, extent)

    @cached_property
    def _radius(self) -> float:
        """Radius of a ball about the collider's origin that contains the solid, or of one that reaches past the
        surface."""
        corners = np.maximum(np.abs(self.collider.lower), np.abs(self.collider.upper))
        reach = float(np.linalg.norm(self.surface - self.place, axis=1).max())
        return min(float(np.linalg.norm(corners)), 2.0 * reach)

    @cached_property
    def clear_of_surface(self) -> float:
        """The s at which the march begins: every node is outside the collider's ball [m]."""
        return float(((self.surface - self.place) @ self.normal).max()) + self._radius

    def _why_never(self, depth: float) -> str:
        """Why the collider never gets so deep on this line."""
        collider, never = (
            self.collider,
            f"On this line collider {self.collider.name!r} never gets {depth:.4g} m below",
        )
        along = np.linspace(-self._radius, self._radius, _ALONG_THE_LINE)[:, None] * (
            self.normal @ self.rotation
        )
        if float(collider.sdf(along).min()) > 0.0:
            away = float(np.linalg.norm(0.5 * (collider.lower + collider.upper)))
            return (
                f"{never} the surface: its origin is aimed at the place, but the collider lies beside it, with its "
                f"middle {away:.4g} m away; move the middle of the file to the origin with `centre = true`."
            )
        return f"{never} the surface: the depth is more than the collider is thick."

    @cached_property
    def _deepest(self) -> _DeepestPoint:
        return _DeepestPoint(self, self.clear_of_surface)

    def _march(self, s: float, depth: float, end: float = -np.inf) -> float:
        """The first s, inward from the given one to the end, with this depth [m]."""
        deepest = self._deepest
        shortest = _SHORTEST_STEP * self._length
        lowest = s - 4.0 * (self._radius + float(np.ptp((self.surface - self.place) @ self.normal)) + depth)
        lowest = max(lowest, end)
        to_go = depth - deepest.depth(s)
        while to_go > 0.0:
            last, s = s, s - max(to_go, shortest)
            to_go = depth - deepest.depth(s)
            if s < lowest:
                raise OutOfReach(self._why_never(depth))
            if to_go <= 0.0:
                exact = _EXACT * self._length
                if -to_go <= exact:  # there, so that round-off would decide the sign
                    return s
                try:
                    root = brentq(
                        lambda t: depth - deepest.depth(t), s, last, xtol=exact, rtol=4 * np.finfo(float).eps
                    )
                    return float(root)
                except ValueError as error:  # a slope far above one: near nodes were taken to be far
                    raise OutOfReach(
                        f"On this line the distance of collider {self.collider.name!r} changes too fast to find "
                        f"where it is {depth:.4g} m below the surface: give it a finer `resolution`."
                    ) from error
        return s


class _DeepestPoint:
    """`Approach.depth` for many nearby s: skips nodes that cannot be the deepest.

    A node whose distance was v at s' is no closer than v - slope |s - s'| at s. The slope of an exact distance is 1,
    and a little more for one that is smoothed or interpolated from a grid.
    """

    _SLOPE = 1.2

    def __init__(self, approach: Approach, s: float) -> None:
        self._approach = approach
        self._distance = self._sdf(s, slice(None))
        self._seen_at = np.full(len(approach.surface), s)

    def depth(self, s: float) -> float:
        bound = self._distance - self._SLOPE * np.abs(s - self._seen_at)
        likely = int(np.argmin(bound))
        closest = self._sdf(s, slice(likely, likely + 1))[0]
        possible = np.flatnonzero(bound <= closest)
        if len(possible):
            self._distance[possible] = self._sdf(s, possible)
            self._seen_at[possible] = s
            closest = min(closest, self._distance[possible].min())
        return -float(closest)

    def _sdf(self, s: float, nodes: slice | IntArray) -> Array:
        return self._approach.collider.sdf(
            self._approach.pose(s).apply_inverse(self._approach.surface[nodes])
        )
