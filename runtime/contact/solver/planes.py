"""The signed distance of points of a body from planes through sharp points of colliders (`pressed_points.py`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import SdfDerivatives
from softprint.runtime.colliders.pose import RigidPose


@dataclass(frozen=True, eq=False)
class Planes:
    """k planes, each fixed to a collider: through place (k, dim) [m], with normals direction (k, dim)."""

    place: Array
    direction: Array

    def take(self, which: IntArray) -> Planes:
        """Some of them."""
        return Planes(self.place[which], self.direction[which])

    def distance(self, x: Array, owner: IntArray, poses: Sequence[RigidPose]) -> SdfDerivatives:
        """The signed distances of points x (k, dim), each from its plane, on colliders at poses with numbers owner
        (k,)."""
        p, g = np.empty_like(x), np.empty_like(x)
        for number in np.unique(owner):
            mine = owner == number
            p[mine], g[mine] = (
                poses[number].apply(self.place[mine]),
                poses[number].rotate(self.direction[mine]),
            )
        return SdfDerivatives(((x - p) * g).sum(axis=1), g, np.zeros((*x.shape, x.shape[1])))
