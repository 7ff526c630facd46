"""The exponential map of SO(2) and SO(3), for small increments of rigid frames; the rotations nearest to matrices."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.compiled import compiled

# Matrices whose determinant is less than this share of that of a rotation of their size are projected by singular value
# decomposition instead: near an inversion Newton's iteration is slow, and beyond it converges to a reflection.
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


@compiled(reference=lambda w: expm(skew(w)))
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


@compiled(reference=lambda R, w: np.array([rotation @ expm(skew(v)) for rotation, v in zip(R, w)]))
def rotated_by(rotations: Array, vectors: Array) -> Array:
    """R exp(skew(w)) of rotations (n, dim, dim) and rotation vectors (n, spin) [rad]."""
    result = np.empty_like(rotations)
    for k in range(len(rotations)):
        result[k] = rotations[k] @ _exponential(vectors[k])
    return result


def _moved(frames: Array, pivots: Array, steps: Array) -> Array:
    dim = pivots.shape[1]
    rotated = np.array([frame[:dim] @ expm(skew(step[dim:])).T for frame, step in zip(frames, steps)])
    back = np.einsum("nr,nrb->nb", pivots, frames[:, :dim] - rotated)
    return np.concatenate([rotated, (frames[:, dim] + steps[:, :dim] + back)[:, None]], axis=1)


@compiled(reference=_moved)
def moved_frames(frames: Array, pivots: Array, steps: Array) -> Array:
    """R^T and t (n, dim+1, dim) of frames after steps (n, dim+spin) that move their pivots (n, dim) by u and rotate
    about them by w: R' = exp(w) R and p' = p + u, with p = X_pivot R^T + t."""
    n, dim = pivots.shape
    result = np.empty(frames.shape)
    for f in range(n):
        E = _exponential(steps[f, dim:])
        for b in range(dim):
            place = frames[f, dim, b] + steps[f, b]
            for r in range(dim):
                result[f, r, b] = 0.0
                for c in range(dim):
                    result[f, r, b] += frames[f, r, c] * E[b, c]
                # As one difference, so that a frame with a zero step keeps its position bit for bit.
                place += pivots[f, r] * (frames[f, r, b] - result[f, r, b])
            result[f, dim, b] = place
    return result


def _tangents(frames: Array, pivots: Array, generators: Array) -> Array:
    n, dim = pivots.shape
    rotated = np.einsum("nij,sjk->niks", frames[:, :dim], generators)
    places = np.concatenate(
        [np.broadcast_to(np.eye(dim), (n, dim, dim)), np.einsum("ni,niks->nks", pivots, rotated)], axis=-1
    )
    linear = np.pad(-rotated, ((0, 0), (0, 0), (0, 0), (dim, 0)))
    return np.concatenate([linear, places[:, None]], axis=1).reshape(n, (dim + 1) * dim, -1)


@compiled(reference=_tangents)
def frame_tangents(frames: Array, pivots: Array, generators: Array) -> Array:
    """Derivative of frames' rows by their own steps (n, (dim+1)*dim, dim+spin), see `moved_frames`; generators: W of
    unit rotations (spin, dim, dim). From exp(w)^T = I - W + ..., d(R^T) = -R^T W and, with the pivot fixed, dt =
    X_pivot R^T W."""
    n, dim = pivots.shape
    tangents = np.zeros((n, dim + 1, dim, dim + len(generators)))
    for f in range(n):
        for k in range(dim):
            tangents[f, dim, k, k] = 1.0
            for s in range(len(generators)):
                for i in range(dim):
                    rotated = 0.0
                    for j in range(dim):
                        rotated += frames[f, i, j] * generators[s, j, k]
                    tangents[f, i, k, dim + s] = -rotated
                    tangents[f, dim, k, dim + s] += pivots[f, i] * rotated
    return tangents.reshape(n, (dim + 1) * dim, dim + len(generators))


def _slopes(frames: Array, pivots: Array, slopes: Array, generators: Array) -> Array:
    return np.einsum("nrt,nr->nt", _tangents(frames, pivots, generators), slopes.reshape(len(slopes), -1))


@compiled(reference=_slopes)
def frame_slopes(frames: Array, pivots: Array, slopes: Array, generators: Array) -> Array:
    """Gradient of E by the frames' own steps (n, dim+spin) from slopes dE/d rows (n, dim+1, dim): the transpose of
    `frame_tangents` times the slopes."""
    n, dim = pivots.shape
    result = np.zeros((n, dim + len(generators)))
    for f in range(n):
        moment = np.zeros((dim, dim))
        for k in range(dim):
            result[f, k] = slopes[f, dim, k]
            for i in range(dim):
                levered = slopes[f, i, k] - pivots[f, i] * slopes[f, dim, k]
                for j in range(dim):
                    moment[j, k] += frames[f, i, j] * levered
        for s in range(len(generators)):
            for j in range(dim):
                for k in range(dim):
                    result[f, dim + s] -= generators[s, j, k] * moment[j, k]
    return result


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
    polar = _polar_2d if matrices.shape[1] == 2 else _polar_3d
    for k in np.flatnonzero(polar(np.ascontiguousarray(matrices), rotations)):
        rotations[k] = nearest_rotation(matrices[k])
    return rotations


def _by_singular_values(matrices: Array, rotations: Array) -> tuple[BoolArray, Array]:
    """The same by singular value decomposition, for matrices far from singular: none is skipped."""
    return np.zeros(len(matrices), dtype=bool), np.array([nearest_rotation(matrix) for matrix in matrices])


@compiled(reference=_by_singular_values)
def _polar_2d(matrices: Array, rotations: Array) -> BoolArray:
    """Writes the polar factors into rotations; returns a mask (n,) of the matrices that it skipped."""
    left = np.zeros(len(matrices), dtype=np.bool_)
    for k in range(len(matrices)):
        F, Q = matrices[k], rotations[k]
        c, s = F[0, 0] + F[1, 1], F[1, 0] - F[0, 1]
        length = np.sqrt(c * c + s * s)
        left[k] = length == 0.0
        Q[0, 0] = Q[1, 1] = c / length
        Q[1, 0], Q[0, 1] = s / length, -s / length
    return left


@compiled(reference=_by_singular_values)
def _polar_3d(matrices: Array, rotations: Array) -> BoolArray:
    """As `_polar_2d`, for blocks of some tens of matrices, entry by entry, so that the compiler can vectorise the
    loops."""
    n, together = len(matrices), 64
    left = np.zeros(n, dtype=np.bool_)
    q, moved, first = np.empty((9, together)), np.empty(together), np.empty(together)
    for start in range(0, n, together):
        count = min(together, n - start)
        for i in range(9):
            for k in range(together):
                q[i, k] = matrices[start + min(k, count - 1), i // 3, i % 3]
        for iteration in range(30):
            for k in range(together):
                a, b, c = q[0, k], q[1, k], q[2, k]
                d, e, f = q[3, k], q[4, k], q[5, k]
                g, h, i9 = q[6, k], q[7, k], q[8, k]
                A, B, C = e * i9 - f * h, f * g - d * i9, d * h - e * g
                D, E, F = c * h - b * i9, a * i9 - c * g, b * g - a * h
                G, H, J = b * f - c * e, c * d - a * f, a * e - b * d
                det = a * A + b * B + c * C
                size = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i9 * i9
                inverse = A * A + B * B + C * C + D * D + E * E + F * F + G * G + H * H + J * J
                if iteration == 0:
                    first[k] = det - _FLAT * (size / 3.0) * np.sqrt(size / 3.0)
                scale = np.sqrt(np.sqrt(inverse / size) / det)
                x, y = 0.5 * scale, 0.5 / (det * scale)
                a1, b1, c1 = x * a + y * A, x * b + y * B, x * c + y * C
                d1, e1, f1 = x * d + y * D, x * e + y * E, x * f + y * F
                g1, h1, j1 = x * g + y * G, x * h + y * H, x * i9 + y * J
                q[0, k], q[1, k], q[2, k] = a1, b1, c1
                q[3, k], q[4, k], q[5, k] = d1, e1, f1
                q[6, k], q[7, k], q[8, k] = g1, h1, j1
                change = (a1 - a) ** 2 + (b1 - b) ** 2 + (c1 - c) ** 2
                change += (d1 - d) ** 2 + (e1 - e) ** 2 + (f1 - f) ** 2
                moved[k] = change + (g1 - g) ** 2 + (h1 - h) ** 2 + (j1 - i9) ** 2
            going = False
            for k in range(together):  # the next change would be the square
                going |= first[k] > 0.0 and moved[k] > 1e-16
            if not going:
                break
        for k in range(count):
            left[start + k] = first[k] <= 0.0
            for i in range(9):
                rotations[start + k, i // 3, i % 3] = q[i, k]
    return left
