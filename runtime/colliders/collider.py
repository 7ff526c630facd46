"""The interface of all colliders: a signed distance (negative inside, metres) with gradient and Hessian.

All coordinates are the collider's own; `RigidPose` transforms them to the world. The Hessian matters: without the
curvature of the distance the Newton iterations of contact only converge linearly.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.pose_kernels import rotated


class SdfDerivatives(NamedTuple):
    """Signed distance at n points: value (n,) [m], gradient (n, dim) [1], Hessian (n, dim, dim) [1/m]."""

    value: Array
    gradient: Array
    hessian: Array

    def take(self, index: IntArray | BoolArray | slice) -> SdfDerivatives:
        return SdfDerivatives(self.value[index], self.gradient[index], self.hessian[index])

    def rotated(self, pose: RigidPose) -> SdfDerivatives:
        """The same in world coordinates, for a collider at a pose."""
        return SdfDerivatives(self.value, *rotated(self.gradient, self.hessian, pose.rotation))


class Collider(Protocol):
    """A rigid solid. `lower` and `upper` (dim,) bound it in its own coordinates; `size` is half of its
    largest extent [m]."""

    @property
    def name(self) -> str: ...
    @property
    def dim(self) -> int: ...
    @property
    def lower(self) -> Array: ...
    @property
    def upper(self) -> Array: ...
    @property
    def size(self) -> float: ...

    def __hash__(self) -> int: ...

    def sdf(self, z: Array) -> Array:
        """Signed distance (n,) [m] at local points z (n, dim); cheaper than the derivatives, for culling."""
        ...

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        """Signed distance, gradient and Hessian at local points z (n, dim)."""
        ...

    def sdf_derivatives_at(self, x: Array, pose: RigidPose) -> SdfDerivatives:
        """The same in world coordinates, at world points x (n, dim) with the collider at a pose."""
        ...

    def about(self, z: Array, distance: float) -> IntArray:
        """Indices of the local points z (n, dim) within `distance` [m] of the bounds."""
        ...

    def closer(self, z: Array, distance: float) -> tuple[IntArray, Array]:
        """Indices (m,) of the local points z (n, dim) closer than `distance` [m], and their signed distances (m,)."""
        ...

    def closer_to(self, x: Array, pose: RigidPose, distance: float) -> tuple[IntArray, Array, Array]:
        """The same for world points x (n, dim); returns indices, local coordinates (m, dim) and signed distances."""
        ...


class ColliderBase:
    """Default implementations, from the bounds and the derivatives."""

    name: str
    lower: Array
    upper: Array

    @property
    def dim(self) -> int:
        return int(self.lower.size)

    def closer(self, z: Array, distance: float) -> tuple[IntArray, Array]:
        """See `Collider`."""
        index = self.about(z, distance)
        value = self.sdf(z[index])
        close = value < distance
        return index[close], value[close]

    def closer_to(self, x: Array, pose: RigidPose, distance: float) -> tuple[IntArray, Array, Array]:
        """See `Collider`."""
        z = pose.apply_inverse(x)
        index, value = self.closer(z, distance)
        return index, z[index], value

    def about(self, z: Array, distance: float) -> IntArray:
        """See `Collider`."""
        lower, upper = self.lower - distance, self.upper + distance
        within = (z[:, 0] > lower[0]) & (z[:, 0] < upper[0])
        for axis in range(1, z.shape[1]):
            within &= (z[:, axis] > lower[axis]) & (z[:, axis] < upper[axis])
        return np.flatnonzero(within)

    @property
    def size(self) -> float:
        return float(0.5 * (self.upper - self.lower).max())

    def sdf(self, z: Array) -> Array:
        return self.sdf_derivatives(z).value

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        raise NotImplementedError

    def sdf_derivatives_at(self, x: Array, pose: RigidPose) -> SdfDerivatives:
        """See `Collider`."""
        return self.sdf_derivatives(pose.apply_inverse(x)).rotated(pose)


def norm_derivatives(v: Array) -> SdfDerivatives:
    """|v| with gradient v/|v| and Hessian (I - n n^T)/|v| for v (n, dim).

    At v = 0, the kink of the norm, gradient and Hessian are zero, so that Newton steps stay finite there.
    """
    length = np.linalg.norm(v, axis=1)
    inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
    n = v * inverse[:, None]
    hessian = (np.eye(v.shape[1]) - n[:, :, None] * n[:, None, :]) * inverse[:, None, None]
    return SdfDerivatives(length, n, hessian)
