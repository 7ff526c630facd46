"""The exponential map of SO(2) and SO(3), for small increments of rigid frames."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array


def rotation_dofs(dim: int) -> int:
    """Numbers in a rotation vector: 1 (an angle) in 2D, 3 in 3D."""
    return dim * (dim - 1) // 2


def skew(vector: Array) -> Array:
    """Skew matrix of a rotation vector [rad]: (1,) -> (2, 2), (3,) -> (3, 3) with skew(w) x = w cross x."""
    if len(vector) == 1:
        return np.array([[0.0, -vector[0]], [vector[0], 0.0]])
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_exponential(vector: Array) -> Array:
    """exp(skew(vector)): the rotation by |vector| radians (Rodrigues). (1,) -> (2, 2), (3,) -> (3, 3)."""
    angle = float(np.linalg.norm(vector))
    generator = skew(vector)
    # sin(a)/a and (1 - cos a)/a^2 through sinc: exact at 0. np.sinc(x) = sin(pi x)/(pi x).
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.eye(len(generator)) + first * generator + second * generator @ generator


def nearest_rotation(matrix: Array) -> Array:
    """The rotation nearest to a (dim, dim) matrix in the Frobenius norm (orthogonal Procrustes)."""
    left, _, right = np.linalg.svd(matrix)
    if np.linalg.det(left @ right) < 0:
        left[:, -1] *= -1
    return left @ right
