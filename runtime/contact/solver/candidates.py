"""Contact candidates: the contact points near a collider, and their signed distance to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider, SdfDerivatives
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.contact.solver.planes import Planes
from softprint.runtime.lazy import lazy

# A dent may push in neighbouring points that are outside the collider by up to this fraction of its depth. Farther out
# this is rare (under thin and curved colliders, one in fifty active points); those are found after the solve.
MARGIN = 0.25


@dataclass(frozen=True, eq=False)
class PosedCollider:
    """The signed distance to a collider at a pose."""

    collider: Collider
    pose: RigidPose

    def __call__(self, x: Array) -> SdfDerivatives:
        return self.collider.sdf_derivatives_at(x, self.pose)

    def value(self, x: Array) -> Array:
        """The signed distance (n,) [m] at x (n, dim), without derivatives."""
        return self.collider.sdf(self.pose.apply_inverse(x))


@dataclass(frozen=True, eq=False)
class PointDistance:
    """The signed distance of each of m points to the collider that it is in contact with. names: of the colliders in
    their scene; owner: (m,) number of that collider; planes: of the last points, which are pressed by sharp points of
    their colliders."""

    names: tuple[str, ...]
    colliders: tuple[PosedCollider, ...]
    owner: IntArray
    planes: Planes | None = None

    def value(self, x: Array) -> Array:
        """The signed distances (m,) [m] at x (m, dim), without derivatives."""
        if self.planes is not None:
            first = self._first
            return np.concatenate([self._facets.value(x[:first]), self._placed.value(x[first:])])
        if len(self.colliders) == 1:
            return self.colliders[0].value(x)
        found = np.empty(len(x))
        for mine, collider in zip(self._owned, self.colliders, strict=True):
            found[mine] = collider.value(x[mine])
        return found

    def among(self, which: BoolArray | IntArray) -> PointDistance:
        """For some of the points (m,), ascending."""
        if self.planes is None:
            return PointDistance(self.names, self.colliders, self.owner[which])
        index = np.arange(len(self.owner))[which]
        first = self._first
        pressed = index[index >= first] - first
        planes = self.planes.take(pressed) if len(pressed) else None
        return PointDistance(self.names, self.colliders, self.owner[index], planes)

    @property
    def poses(self) -> list[RigidPose]:
        """Of the colliders."""
        return [one.pose for one in self.colliders]

    def at(self, poses: Poses) -> PointDistance:
        """With the colliders at other poses, those that have one there."""
        moved = (
            replace(one, pose=poses.get(name, one.pose))
            for name, one in zip(self.names, self.colliders, strict=True)
        )
        return PointDistance(self.names, tuple(moved), self.owner, self.planes)

    def __call__(self, x: Array) -> SdfDerivatives:
        if self.planes is not None:
            return self._placed.following(self._facets(x[: self._first]), x)
        if len(self.colliders) == 1:
            return self.colliders[0](x)
        m, dim = x.shape
        found = SdfDerivatives(np.empty(m), np.empty((m, dim)), np.empty((m, dim, dim)))
        for mine, collider in zip(self._owned, self.colliders, strict=True):
            for column, own in zip(found, collider(x[mine]), strict=True):
                column[mine] = own
        return found

    @lazy
    def _owned(self) -> list[IntArray]:
        """For each collider, its points."""
        return [np.flatnonzero(self.owner == number) for number in range(len(self.colliders))]

    @lazy
    def _first(self) -> int:
        """The first of the points that have planes."""
        return len(self.owner) - (0 if self.planes is None else len(self.planes.place))

    @lazy
    def _facets(self) -> PointDistance:
        """Of the points before these."""
        return PointDistance(self.names, self.colliders, self.owner[: self._first])

    @lazy
    def _placed(self) -> Planes:
        """The planes in the world."""
        assert self.planes is not None
        return self.planes.placed(self.owner[self._first :], self.poses)


def carried(
    y: Array, owner: IntArray, before: Sequence[RigidPose], after: Sequence[RigidPose]
) -> tuple[Array, Array]:
    """dc (m, dim) [m] and T (m, dim, dim): how far, and by which rotations, the colliders that own them (m,) carry
    points at y (m, dim) along from their poses before to those after."""
    follows, rotations = np.empty_like(y), np.empty((*y.shape, y.shape[1]))
    for number, (start, end) in enumerate(zip(before, after, strict=True)):
        mine = slice(None) if len(before) == 1 else owner == number
        follows[mine] = end.apply(start.apply_inverse(y[mine])) - y[mine]
        rotations[mine] = end.rotation @ start.rotation.T
    return follows, rotations


@dataclass(frozen=True, eq=False)
class ActiveSet:
    """The active points (k,) of a state, ascending, with their carriers A (k, dim, dim), the gradient of the signed
    distance there, normal (k, dim), and the largest displacement of any of them [m]."""

    index: IntArray
    carriers: Array
    normal: Array
    displacement: float

    def take(self, which: BoolArray) -> ActiveSet:
        """Some of them (k,)."""
        return ActiveSet(self.index[which], self.carriers[which], self.normal[which], self.displacement)

    def pushed_in(self, surface_normal: Array) -> BoolArray:
        """Which of them (k,) the collider pushes into the body, so that it is on the outer side of the surface:
        A N . g < 0, with the surface normals at rest N (n_nodes, dim)."""
        deformed = (self.carriers @ surface_normal[self.index][..., None])[..., 0]
        return np.asarray((deformed * self.normal).sum(axis=1) < 0.0)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Points (n,), ascending, near a collider. distance: (n,) [m] and position: (n, dim) [m], without contact
    displacement; depth: estimate of their contact displacement [m], usually the depth of the deepest point;
    may_be_active: (n,) which of them take part in the contact solve."""

    index: IntArray
    distance: Array
    position: Array
    depth: float
    may_be_active: BoolArray

    @classmethod
    def none(cls, dim: int) -> Candidates:
        """No points."""
        nothing = np.empty(0)
        return cls(np.empty(0, dtype=np.int64), nothing, np.empty((0, dim)), 0.0, np.empty(0, dtype=bool))

    def extended(self, index: IntArray, position: Array) -> Candidates:
        """With other points (m,), ascending, that may be active wherever their reduced positions are. Their distance
        counts as zero."""
        joined, n = np.concatenate([self.index, index]), len(index)
        order = np.argsort(joined)
        return Candidates(
            joined[order],
            np.concatenate([self.distance, np.zeros(n)])[order],
            np.concatenate([self.position, position])[order],
            self.depth,
            np.concatenate([self.may_be_active, np.ones(n, dtype=bool)])[order],
        )

    def followed_by(self, index: IntArray, distance: Array, position: Array, active: BoolArray) -> Candidates:
        """With points (k,) of greater numbers, at their distances and positions; active: (k,) which may be active in
        any case."""
        depth = max(self.depth, -float(distance.min(initial=0.0)))
        return Candidates(
            np.concatenate([self.index, index]),
            np.concatenate([self.distance, distance]),
            np.concatenate([self.position, position]),
            depth,
            np.concatenate([self.may_be_active, active | (distance < MARGIN * depth)]),
        )

    @property
    def any_inside(self) -> bool:
        """Whether any point is inside the collider."""
        return bool((self.distance < 0.0).any())

    def with_possibly_active(self, more: BoolArray) -> Candidates:
        """With more points (n,) that may be active."""
        return replace(self, may_be_active=self.may_be_active | more)


class Faces(Protocol):
    """Which of the points (m,) at x (m, dim) [m] the collider of a part, by its number, faces from outside of the
    body."""

    def __call__(self, number: int, index: IntArray, x: Array) -> BoolArray: ...


def merge(parts: Sequence[Candidates], faces: Faces) -> tuple[Candidates, IntArray]:
    """The candidates of several colliders together: every point once, ascending, and its owner, the number of the part
    in which it is deepest, of those whose colliders face it if any do: what is inside a ball that is pressed through a
    sheet is on the ground below it. A point may be active if it may be in any part."""
    if len(parts) == 1:
        return parts[0], np.zeros(len(parts[0].index), dtype=np.int64)
    index = np.concatenate([part.index for part in parts])
    distance = np.concatenate([part.distance for part in parts])
    position = np.concatenate([part.position for part in parts])
    may_be_active = np.concatenate([part.may_be_active for part in parts])
    owner = np.repeat(np.arange(len(parts)), [len(part.index) for part in parts])
    order = np.lexsort((distance, _turned_away(index, position, owner, faces), index))
    starts = np.flatnonzero(np.diff(index[order], prepend=-1) > 0)
    first = order[starts]
    anywhere = np.logical_or.reduceat(may_be_active[order], starts) if len(starts) else may_be_active
    depth = max(part.depth for part in parts)
    return Candidates(index[first], distance[first], position[first], depth, anywhere), owner[first]


def _turned_away(index: IntArray, position: Array, owner: IntArray, faces: Faces) -> BoolArray:
    """(n,) which are of a collider that does not face them, of those that are near several."""
    turned = np.zeros(len(index), dtype=bool)
    if len(index) == 0:
        return turned
    shared = np.flatnonzero(np.bincount(index)[index] > 1)
    for number in sorted(set(owner[shared].tolist())):
        mine = shared[owner[shared] == number]
        turned[mine] = ~faces(number, index[mine], position[mine])
    return turned
