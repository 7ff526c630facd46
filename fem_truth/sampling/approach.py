"""Bringing a collider along a line until it is exactly so deep below a surface.

The collider's origin travels on the line p + s n, inward as s falls, its rotation fixed. Its depth below the
surface nodes x_i is -min_i sdf(R^T (x_i - p - s n)). The pose wanted is the *first* one, coming from outside,
at which that depth is reached: a signed distance has slope at most one, so steps no longer than the distance
still to go cannot jump over it (sphere tracing), and a bracketing root finder does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from runtime.arrays import Array, IntArray
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose

# Root finder's tolerance and shortest march, in sizes of the collider. The first is the exactness of every
# depth; the second only bounds how far the march may overstep before the root is bracketed.
_EXACT = 1e-12
_SHORTEST_STEP = 1e-3
# A collider goes in to this share of its thickness, which is looked for in steps of so many sizes of the collider; the
# depth has stopped growing where it gains less than a share of the step.
_THICKNESS_SHARE, _THICKNESS_STEP, _STILL_GROWING = 0.75, 0.02, 0.2
# A node that a corner grazes at less than this share of the depth asked for says nothing of its thickness.
_GRAZE = 0.1


class OutOfReach(Exception):
    """The collider cannot be brought so deep on this line; the message says so for the file."""


@dataclass(frozen=True, eq=False)
class Approach:
    """A line of approach to a surface.

    surface: (n, dim) nodes [m]; place: (dim,) the point aimed at [m]; normal: (dim,) unit outward normal
    there; rotation: (dim, dim) of the collider.
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
        """Depth of the collider's deepest point below the surface [m]; negative while it is clear of it."""
        return -float(self.collider.sdf(self.pose(s).apply_inverse(self.surface)).min())

    def poses_at(self, depths: Array) -> list[RigidPose]:
        """Poses at ascending depths (k,) [m]; each is the first on the way in that is so deep.

        Raises OutOfReach where a depth is more than collider and body allow on this line.
        """
        s = self.clear_of_surface
        deepest = _DeepestPoint(self, s)
        poses = []
        for depth in depths:
            s = self._march(deepest, s, float(depth))
            poses.append(self.pose(s))
        return poses

    def sensible(self, depth: float) -> float:
        """As much of a depth [m] as the collider is thick enough for where it comes in.

        Nodes that come nearer to the other side of a wall, a rim or a prong than to the side that met them would be
        pushed out there: what the signed distance says of them is no longer what happens. Followed on the way in, the
        depth then stops growing; a share of where it does is taken.
        """
        step = _THICKNESS_STEP * self._length
        s, reached = self.clear_of_surface, -np.inf
        lowest = s - 4.0 * self._radius
        deepest = _DeepestPoint(self, s)
        while _THICKNESS_SHARE * reached < depth and s > lowest:
            before, s = reached, s - max(-reached if np.isfinite(reached) else 0.0, step)
            reached = deepest.depth(s)
            if before > _GRAZE * depth and reached < before + _STILL_GROWING * step:
                return min(depth, _THICKNESS_SHARE * before)
        return depth

    @property
    def _length(self) -> float:
        """A length that belongs to both the collider and the surface: half spaces have no size of their
        own."""
        extent = float(np.ptp(self.surface, axis=0).max())
        return min(self.collider.size, extent)

    @property
    def _radius(self) -> float:
        """Radius of a ball about the collider's origin that holds the solid, or one that reaches past the
        surface."""
        corners = np.maximum(np.abs(self.collider.lower), np.abs(self.collider.upper))
        reach = float(np.linalg.norm(self.surface - self.place, axis=1).max())
        return min(float(np.linalg.norm(corners)), 2.0 * reach)

    @property
    def clear_of_surface(self) -> float:
        """The s at which the march begins: every node lies beyond the collider's ball [m]."""
        return float(((self.surface - self.place) @ self.normal).max()) + self._radius

    def _march(self, deepest: _DeepestPoint, s: float, depth: float) -> float:
        shortest = _SHORTEST_STEP * self._length
        lowest = s - 4.0 * (self._radius + float(np.ptp((self.surface - self.place) @ self.normal)) + depth)
        to_go = depth - deepest.depth(s)
        while to_go > 0.0:
            last, s = s, s - max(to_go, shortest)
            to_go = depth - deepest.depth(s)
            if s < lowest:
                raise OutOfReach(
                    f"On this line collider {self.collider.name!r} never gets {depth:.4g} m below the "
                    "surface: the depth is more than the collider is thick."
                )
            if to_go <= 0.0:
                tolerances = {"xtol": _EXACT * self._length, "rtol": 4 * np.finfo(float).eps}
                try:
                    return float(brentq(lambda t: depth - deepest.depth(t), s, last, **tolerances))
                except ValueError as error:  # a distance much steeper than one: nodes were taken to be far
                    raise OutOfReach(
                        f"On this line the distance of collider {self.collider.name!r} changes too fast to find "
                        f"where it is {depth:.4g} m below the surface: give it a finer `resolution`."
                    ) from error
        return s


class _DeepestPoint:
    """`Approach.depth` for many s near each other: nodes that cannot be the deepest are not looked at again.

    A node whose distance was v at s' is no closer than v - slope |s - s'| at s, the slope of a distance being
    1, and of one that is smoothed or interpolated from a grid a little more.
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
