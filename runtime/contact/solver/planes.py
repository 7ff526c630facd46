"""The signed distance of points of a body from planes through sharp points of colliders (`pressed_points.py`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import SdfDerivatives
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.compiled import compiled


@dataclass(frozen=True, eq=False)
class Planes:
    """k planes, each fixed to a collider: through place (k, dim) [m], with normals direction (k, dim), in the
    coordinates of that collider, or in the world."""

    place: Array
    direction: Array

    def take(self, which: IntArray) -> Planes:
        """Some of them."""
        return Planes(self.place[which], self.direction[which])

    def placed(self, owner: IntArray, poses: Sequence[RigidPose]) -> Planes:
        """In the world, on colliders at poses with numbers owner (k,)."""
        if len(poses) == 1:
            return Planes(poses[0].apply(self.place), poses[0].rotate(self.direction))
        p, g = np.empty_like(self.place), np.empty_like(self.direction)
        for number in np.unique(owner):
            mine, pose = owner == number, poses[number]
            p[mine], g[mine] = pose.apply(self.place[mine]), pose.rotate(self.direction[mine])
        return Planes(p, g)

    def value(self, x: Array) -> Array:
        """The signed distances (k,) [m] of points x (k, dim), each from its plane, in the same coordinates."""
        return np.asarray(((x - self.place) * self.direction).sum(axis=1))

    def along(self, x: Array) -> Array:
        """The parts along the planes (k, dim) [m] of the ways to points x (k, dim), each from its place."""
        return np.asarray(x - self.place - self.value(x)[:, None] * self.direction)

    def following(self, others: SdfDerivatives, x: Array) -> SdfDerivatives:
        """The distance of n points from something else, followed by that of the last k of points x (n + k, dim)."""
        return SdfDerivatives(*_joined(*others, x, self.place, self.direction))


@compiled
def _joined(
    value: Array, gradient: Array, hessian: Array, x: Array, place: Array, direction: Array
) -> tuple[Array, Array, Array]:
    """Signed distances with derivatives of n points, followed by those of the last points x from planes."""
    n, (total, dim) = len(value), x.shape
    s, g, H = np.empty(total), np.empty((total, dim)), np.zeros((total, dim, dim))
    s[:n], g[:n], H[:n] = value, gradient, hessian
    for k in range(total - n):
        s[n + k] = 0.0
        for a in range(dim):
            s[n + k] += direction[k, a] * (x[n + k, a] - place[k, a])
            g[n + k, a] = direction[k, a]
    return s, g, H
