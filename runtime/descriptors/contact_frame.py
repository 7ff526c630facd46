"""The contact frame R = [n, t1, t2] of a point (thesis 6.2.2), in collider coordinates; in the plane [n, t].

While it learns, a network meets random tangents. At run time they are biased, t1 = n x e / |n x e|, t2 = n x t1, which
fails where n is along e. No smooth choice of tangents exists on the whole sphere, so two choices are blended: results
in the frame of e = (1, 0, 0) and in that of (0, 1, 0) are weighted with 1 - w and w,

    w = S((c - LOW) / (HIGH - LOW)),    c = n_1^2,    S(s) = 6 s^5 - 15 s^4 + 10 s^3,

so that each has no weight where it fails, and most normals need only one of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.arrays import Array, IntArray

# Between these squares of the first component of n, the frames of both biases count: 23 % of all normals.
LOW, HIGH = 0.5, 0.9


class Frames(NamedTuple):
    """Frames of m of the points, all of them those of one bias.

    index: (m,) which points; rotation: R (m, dim, dim), its columns n, t1, t2; weight: (m,) what results in this frame
    count; slope, weight_slope: dR_ab/dz_c (m, dim, dim, dim) and dw/dz (m, dim) [1/m] where they were asked for.
    """

    index: IntArray
    rotation: Array
    weight: Array
    slope: Array | None = None
    weight_slope: Array | None = None


def biased_frames(normal: Array, normal_slope: Array | None = None) -> list[Frames]:
    """The frames of run time for unit normals (n, dim), the weights of a point summing to one; normal_slope: dn/dz
    (n, dim, dim)."""
    n, dim = normal.shape
    if dim == 2:
        everything, one = np.arange(n), np.ones(n)
        flat, slope = _flat(normal, normal_slope)
        return [Frames(everything, flat, one, slope, None if slope is None else np.zeros((n, 2)))]
    share = (normal[:, 0] ** 2 - LOW) / (HIGH - LOW)
    s = np.clip(share, 0.0, 1.0)
    second = s**3 * (6 * s**2 - 15 * s + 10)
    second_slope = None
    if normal_slope is not None:
        steep = 30 * s**2 * (1 - s) ** 2 * 2.0 * normal[:, 0] / (HIGH - LOW)
        second_slope = steep[:, None] * normal_slope[:, 0]
    frames = []
    for axis, weight, sign in ((0, 1.0 - second, -1.0), (1, second, 1.0)):
        index = np.flatnonzero(weight > 0.0)
        own_slope = None if normal_slope is None else normal_slope[index]
        rotation, slope = _biased(normal[index], own_slope, axis)
        weight_slope = None if second_slope is None else sign * second_slope[index]
        frames.append(Frames(index, rotation, weight[index], slope, weight_slope))
    return [part for part in frames if len(part.index)]


def random_frames(normal: Array, rng: np.random.Generator) -> Array:
    """R (n, dim, dim) with tangents in any direction about unit normals (n, dim); in 2D there is one choice."""
    n, dim = normal.shape
    if dim == 2:
        return _flat(normal, None)[0]
    some = rng.standard_normal((n, 3))
    some -= (some * normal).sum(axis=1, keepdims=True) * normal
    first = some / np.linalg.norm(some, axis=1, keepdims=True)
    return np.stack([normal, first, np.cross(normal, first)], axis=-1)


def _flat(normal: Array, normal_slope: Array | None) -> tuple[Array, Array | None]:
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    rotation = np.stack([normal, normal @ quarter.T], axis=-1)
    if normal_slope is None:
        return rotation, None
    return rotation, np.stack([normal_slope, quarter @ normal_slope], axis=2)


def _biased(normal: Array, normal_slope: Array | None, axis: int) -> tuple[Array, Array | None]:
    """R (m, 3, 3), and dR/dz (m, 3, 3, 3)."""
    bias = np.eye(3)[axis]
    across = np.cross(normal, bias)
    length = np.linalg.norm(across, axis=1)[:, None]
    first = across / length
    rotation = np.stack([normal, first, np.cross(normal, first)], axis=-1)
    if normal_slope is None:
        return rotation, None
    across_slope = _cross_columns(normal_slope, bias)
    along = np.einsum("na,nac->nc", first, across_slope)
    first_slope = (across_slope - first[:, :, None] * along[:, None, :]) / length[:, :, None]
    second_slope = _cross_columns(normal_slope, first) - _cross_columns(first_slope, normal)
    return rotation, np.stack([normal_slope, first_slope, second_slope], axis=2)


def _cross_columns(slope: Array, vector: Array) -> Array:
    """dv/dz_c x vector for dv/dz (m, 3, 3), column by column; vector: (3,) or (m, 3)."""
    return np.cross(slope, np.broadcast_to(vector, slope.shape[:2])[:, :, None], axis=1)
