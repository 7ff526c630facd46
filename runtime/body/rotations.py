"""The exponential map of SO(2) and SO(3), for small increments of rigid frames; the rotations nearest to matrices."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array, BoolArray
from runtime.compiled import compiled

# Matrices whose determinant is less than this share of that of a rotation of their size are left to singular values:
# nearer to an inversion Newton's iteration is slow, and beyond it finds a reflection.
_FLAT = 1e-3


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


def nearest_rotations(matrices: Array) -> Array:
    """`nearest_rotation` of each of many (n, dim, dim), by Newton's iteration Q <- (c Q + Q^-T / c) / 2 for the polar
    factor, scaled by c^2 = |Q^-T| / |Q| (Higham 1986)."""
    rotations = np.empty(matrices.shape)
    for k in np.flatnonzero(_polar(np.ascontiguousarray(matrices), rotations)):
        rotations[k] = nearest_rotation(matrices[k])
    return rotations


@compiled
def _polar(matrices: Array, rotations: Array) -> BoolArray:
    """Writes the polar factors; which of them it left alone (n,)."""
    n, dim, _ = matrices.shape
    left = np.zeros(n, dtype=np.bool_)
    inverse = np.empty((3, 3))
    for k in range(n):
        Q = rotations[k]
        Q[:] = matrices[k]
        if dim == 2:
            c, s = Q[0, 0] + Q[1, 1], Q[1, 0] - Q[0, 1]
            length = np.sqrt(c * c + s * s)
            left[k] = length == 0.0
            Q[0, 0] = Q[1, 1] = c / length
            Q[1, 0], Q[0, 1] = s / length, -s / length
            continue
        for iteration in range(30):
            size, size_inverse, det = 0.0, 0.0, 0.0
            for i in range(3):
                i1, i2 = (i + 1) % 3, (i + 2) % 3
                for j in range(3):
                    j1, j2 = (j + 1) % 3, (j + 2) % 3
                    inverse[i, j] = Q[i1, j1] * Q[i2, j2] - Q[i1, j2] * Q[i2, j1]
                    size += Q[i, j] * Q[i, j]
                    size_inverse += inverse[i, j] * inverse[i, j]
                det += Q[i, 0] * inverse[i, 0]
            if iteration == 0 and det <= _FLAT * (size / 3.0) ** 1.5:
                left[k] = True
                break
            scale = np.sqrt(np.sqrt(size_inverse / size) / det)
            moved = 0.0
            for i in range(3):
                for j in range(3):
                    after = 0.5 * (scale * Q[i, j] + inverse[i, j] / (det * scale))
                    moved += (after - Q[i, j]) ** 2
                    Q[i, j] = after
            if not moved > 1e-16:  # the next change would be its square
                break
    return left
