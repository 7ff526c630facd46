"""Loads about a collider, and the signed distance that they have of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from runtime.arrays import Array, BoolArray, IntArray
from runtime.colliders.collider import Collider, SdfDerivatives
from runtime.colliders.pose import RigidPose
from runtime.elasticity.invariants import cofactor


class NodeDistance(Protocol):
    """The signed distance at certain loads (m,), each of one collider in the world; x (m, dim) where they are."""

    def __call__(self, x: Array) -> SdfDerivatives: ...

    def value(self, x: Array) -> Array: ...

    def among(self, which: BoolArray) -> NodeDistance:
        """At some of the loads (m,)."""
        ...


@dataclass(frozen=True, eq=False)
class ColliderDistance:
    """The signed distance of a collider in the world."""

    collider: Collider
    pose: RigidPose

    def __call__(self, x: Array) -> SdfDerivatives:
        return self.collider.sdf_derivatives_at(x, self.pose)

    def value(self, x: Array) -> Array:
        """Without its derivatives (n,) [m]."""
        return self.collider.sdf(self.pose.apply_inverse(x))

    def among(self, which: BoolArray) -> ColliderDistance:
        """See `NodeDistance`."""
        return self


@dataclass(frozen=True, eq=False)
class ActiveSet:
    """Loads (k,), ascending, that bear pressure in a state; F (k, dim, dim) and normal (k, dim) of them there, see
    `ContactProblem`; and how far [m] the farthest of them is moved."""

    index: IntArray
    F: Array
    normal: Array
    moved: float

    def take(self, which: BoolArray) -> ActiveSet:
        """Some of them (k,)."""
        return ActiveSet(self.index[which], self.F[which], self.normal[which], self.moved)

    def pushed_in(self, surface_normal: Array) -> BoolArray:
        """Which of them (k,) are pushed into the body, as by a collider that has not got to the wrong side of the
        surface: cof(F) N . g < 0, N being the normals of the surface (n_loads, dim) at rest."""
        carried = (cofactor(self.F) @ surface_normal[self.index][..., None])[..., 0]
        return np.asarray((carried * self.normal).sum(axis=1) < 0.0)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Loads (n,) about a collider, their signed distance (n,) and position (n, dim) [m] undisplaced, by how much they
    will be displaced about [m], the depth of the deepest as a rule, and which of them could bear pressure (n,)."""

    index: IntArray
    distance: Array
    position: Array
    depth: float
    could_bear: BoolArray

    @classmethod
    def nowhere(cls, dim: int) -> Candidates:
        """No loads."""
        none = np.empty(0)
        return cls(none.astype(np.int64), none, np.empty((0, dim)), 0.0, none.astype(bool))

    def joined_by(self, index: IntArray, position: Array) -> Candidates:
        """With other loads (m,), ascending, that could bear pressure wherever they are undisplaced, which counts as at
        the surface."""
        joined, n = np.concatenate([self.index, index]), len(index)
        order = np.argsort(joined)
        return Candidates(
            joined[order],
            np.concatenate([self.distance, np.zeros(n)])[order],
            np.concatenate([self.position, position])[order],
            self.depth,
            np.concatenate([self.could_bear, np.ones(n, dtype=bool)])[order],
        )

    @property
    def reaches_in(self) -> bool:
        """Whether any is inside the collider."""
        return bool((self.distance < 0.0).any())

    def with_bearing(self, more: BoolArray) -> Candidates:
        """Those, too, could bear pressure."""
        return replace(self, could_bear=self.could_bear | more)
