"""The exponential map of SO(2) and SO(3), for small increments of rigid frames."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.compiled import compiled


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
    return _exponential(np.asarray(vector, dtype=np.float64))


@compiled
def _exponential(w: Array) -> Array:
    if len(w) == 1:
        c, s = np.cos(w[0]), np.sin(w[0])
        return np.array([[c, -s], [s, c]])
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = np.sqrt(square)
    # sin(a)/a and (1 - cos a)/a^2, both without cancellation.
    first = np.sin(angle) / angle if angle > 0.0 else 1.0
    half = np.sin(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0
    second = 0.5 * half * half
    rotation = np.empty((3, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rotation[i, i] = 1.0 - second * (w[j] * w[j] + w[k] * w[k])
        rotation[i, j] = second * w[i] * w[j] - first * w[k]
        rotation[i, k] = second * w[i] * w[k] + first * w[j]
    return rotation


def nearest_rotation(matrix: Array) -> Array:
    """The rotation nearest to a (dim, dim) matrix in the Frobenius norm (orthogonal Procrustes)."""
    left, _, right = np.linalg.svd(matrix)
    if np.linalg.det(left @ right) < 0:
        left[:, -1] *= -1
    return left @ right
