"""Loads about a collider, and the signed distance that they have of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from runtime.arrays import Array, BoolArray, IntArray
from runtime.colliders.collider import Collider, SdfDerivatives
from runtime.colliders.pose import RigidPose


class LoadsDistance(Protocol):
    """The signed distance at certain loads (m,), each of one collider in the world; x (m, dim) where they are."""

    def __call__(self, x: Array) -> SdfDerivatives: ...

    def value(self, x: Array) -> Array: ...

    def among(self, which: BoolArray) -> LoadsDistance:
        """At some of the loads (m,)."""
        ...


@dataclass(frozen=True, eq=False)
class PosedDistance:
    """The signed distance of a collider in the world."""

    collider: Collider
    pose: RigidPose

    def __call__(self, x: Array) -> SdfDerivatives:
        return self.collider.sdf_derivatives_at(x, self.pose)

    def value(self, x: Array) -> Array:
        """Without its derivatives (n,) [m]."""
        return self.collider.sdf(self.pose.apply_inverse(x))

    def among(self, which: BoolArray) -> PosedDistance:
        """See `LoadsDistance`."""
        return self


@dataclass(frozen=True, eq=False)
class LoadsAround:
    """Loads (n,) about a collider, their signed distance (n,) and position (n, dim) [m] undisplaced, the depth [m] of
    the deepest, and which of them could bear pressure (n,)."""

    index: IntArray
    distance: Array
    position: Array
    depth: float
    could_bear: BoolArray

    def with_bearing(self, more: BoolArray) -> LoadsAround:
        """Those, too, could bear pressure."""
        return replace(self, could_bear=self.could_bear | more)
