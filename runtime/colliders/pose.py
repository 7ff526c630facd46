"""Rigid poses T in SE(dim): world = R z + t, the z of the thesis's section 5.2 being collider coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from softprint.runtime.arrays import Array
from softprint.runtime.errors import SoftprintError

# Tolerance of orthonormality, for rotations that were written as decimal text.
ORTHONORMAL_TOLERANCE = 1e-6


def rotation_matrix(rotation_vector: ArrayLike, dim: int) -> Array:
    """Rotation (dim, dim) from an angle [rad] in 2D, or from axis times angle [rad], shape (3,), in 3D."""
    vector = np.atleast_1d(np.asarray(rotation_vector, dtype=float))
    if vector.shape != (1 if dim == 2 else 3,):
        wanted = "one angle" if dim == 2 else "axis times angle, three numbers"
        raise SoftprintError(
            f"a rotation in {dim}D is {wanted} in radians, not {vector.size} number(s): {vector.tolist()}"
        )
    if dim == 2:
        c, s = np.cos(vector[0]), np.sin(vector[0])
        return np.array([[c, -s], [s, c]])
    return np.asarray(Rotation.from_rotvec(vector).as_matrix(), dtype=float)


@dataclass(frozen=True, eq=False)
class RigidPose:
    """A rigid motion z -> R z + t.

    rotation: R, (dim, dim), proper orthonormal; translation: t, (dim,) [m]. Raises SoftprintError otherwise.
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation, dtype=float)
        translation = np.array(self.translation, dtype=float)
        dim = translation.size
        if translation.ndim != 1 or dim not in (2, 3) or rotation.shape != (dim, dim):
            raise SoftprintError(
                f"a rigid pose needs a (dim, dim) rotation and a (dim,) translation with dim 2 or 3, "
                f"not shapes {rotation.shape} and {translation.shape}"
            )
        defect = np.abs(rotation.T @ rotation - np.eye(dim)).max()
        if not (
            defect < ORTHONORMAL_TOLERANCE and np.linalg.det(rotation) > 0 and np.isfinite(translation).all()
        ):
            raise SoftprintError(
                f"not a rigid pose: rotation {rotation.tolist()}, translation {translation.tolist()}"
            )
        rotation.setflags(write=False)
        translation.setflags(write=False)
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @classmethod
    def known(cls, rotation: Array, translation: Array) -> RigidPose:
        """From a rotation and a translation that are known to be valid, without checks."""
        pose = object.__new__(cls)
        for name, values in (("rotation", rotation), ("translation", translation)):
            values = np.ascontiguousarray(values)
            values.setflags(write=False)
            object.__setattr__(pose, name, values)
        return pose

    @classmethod
    def identity(cls, dim: int) -> RigidPose:
        return cls(np.eye(dim), np.zeros(dim))

    @classmethod
    def from_rotation_vector(cls, rotation_vector: ArrayLike, translation: ArrayLike) -> RigidPose:
        """From an angle (2D) or axis times angle (3D) [rad] and a translation (dim,) [m]."""
        translation = np.asarray(translation, dtype=float)
        return cls(rotation_matrix(rotation_vector, translation.size), translation)

    @property
    def dim(self) -> int:
        return int(self.translation.size)

    @property
    def matrix(self) -> Array:
        """Homogeneous (dim+1, dim+1) matrix [R t; 0 1]."""
        matrix = np.eye(self.dim + 1)
        matrix[:-1, :-1] = self.rotation
        matrix[:-1, -1] = self.translation
        return matrix

    @property
    def rotation_vector(self) -> Array:
        """Angle, shape (1,), in 2D; axis times angle, shape (3,), in 3D [rad]."""
        if self.dim == 2:
            return np.array([np.arctan2(self.rotation[1, 0], self.rotation[0, 0])])
        return np.asarray(Rotation.from_matrix(self.rotation.copy()).as_rotvec(), dtype=float)

    def is_at(self, other: RigidPose) -> bool:
        """Whether the other pose is the same."""
        return self is other or (
            np.array_equal(self.rotation, other.rotation)
            and np.array_equal(self.translation, other.translation)
        )

    def apply(self, points: Array) -> Array:
        """Local points (n, dim) to the world: R z + t."""
        return points @ self.rotation.T + self.translation

    def apply_inverse(self, points: Array) -> Array:
        """World points (n, dim) to local coordinates: R^T (x - t)."""
        return (points - self.translation) @ self.rotation

    def rotate(self, vectors: Array) -> Array:
        """Local vectors (n, dim) to the world: R v."""
        return vectors @ self.rotation.T

    def rotate_inverse(self, vectors: Array) -> Array:
        """World vectors (n, dim) to the local frame: R^T v."""
        return vectors @ self.rotation

    def rotate_matrices(self, matrices: Array) -> Array:
        """Local second-order tensors (n, dim, dim) to the world: R A R^T."""
        rotated = matrices.reshape(-1, self.dim**2) @ self._rotation_twice.T
        return rotated.reshape(matrices.shape)

    @cached_property
    def _rotation_twice(self) -> Array:
        """R_ac R_bd (dim*dim, dim*dim) over (a, b) and (c, d): one product for all matrices instead of two for each."""
        return np.kron(self.rotation, self.rotation)

    def compose(self, other: RigidPose) -> RigidPose:
        """The pose that applies `other` first and then this one."""
        return RigidPose.known(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def towards(self, other: RigidPose, share: float) -> RigidPose:
        """The pose at a fraction of the way to another, at constant velocity."""
        turn = share * other.compose(self.inverse()).rotation_vector
        translation = (1.0 - share) * self.translation + share * other.translation
        return RigidPose.known(rotation_matrix(turn, self.dim) @ self.rotation, translation)

    def inverse(self) -> RigidPose:
        return RigidPose.known(self.rotation.T.copy(), -self.rotation.T @ self.translation)


# The poses of a scene's colliders, by name.
Poses = Mapping[str, RigidPose]
