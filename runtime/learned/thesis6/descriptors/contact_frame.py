"""The contact frame R = [n, t1, t2] of a point (thesis 6.2.2), in collider coordinates; in the plane [n, t].

In training, tangents are random. At run time they are biased, t1 = n x e / |n x e|, t2 = n x t1, which fails where n is
along e. No smooth choice of tangents exists on the whole sphere, so two choices are blended: results in the frame of
e = (1, 0, 0) and in that of (0, 1, 0) are weighted with 1 - w and w,

    w = S((c - LOW) / (HIGH - LOW)),    c = n_1^2,    S(s) = 6 s^5 - 15 s^4 + 10 s^3,

so that each has no weight where it fails, and most normals need only one of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray

# Between these squares of the first component of n, the frames of both biases have weight: 23 % of all normals.
LOW, HIGH = 0.5, 0.9
_QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # rotation by 90 degrees, from n to t in the plane


class Frames(NamedTuple):
    """Frames of m of the points, with one bias.

    at: (m,) which points; rotation: R (m, dim, dim), its columns n, t1, t2; weight: (m,) of results in this frame;
    bias: the number of the axis e.
    """

    at: IntArray
    rotation: Array
    weight: Array
    bias: int


class MovingFrames(NamedTuple):
    """Frames with their derivatives: slope: dR_ab/dz_c (m, dim, dim, dim), weight_slope: dw/dz (m, dim) [1/m]."""

    at: IntArray
    rotation: Array
    weight: Array
    bias: int
    slope: Array
    weight_slope: Array


def biased_frames(normal: Array) -> list[Frames]:
    """The frames at run time for unit normals (n, dim). The weights of a point sum to one."""
    n, dim = normal.shape
    if dim == 2:
        return [Frames(np.arange(n), _flat(normal), np.ones(n), 0)]
    second = _smooth(_towards_second(normal))
    choices = [
        (axis, np.flatnonzero(weight > 0.0), weight) for axis, weight in enumerate((1.0 - second, second))
    ]
    return [
        Frames(index, _biased(normal[index], axis), weight[index], axis)
        for axis, index, weight in choices
        if len(index)
    ]


def moving_frames(normal: Array, normal_slope: Array) -> list[MovingFrames]:
    """`biased_frames` with derivatives, from dn/dz (n, dim, dim)."""
    dim = normal.shape[1]
    s = _towards_second(normal) if dim == 3 else np.zeros(len(normal))
    steep = 30 * s**2 * (1 - s) ** 2 * 2.0 * normal[:, 0] / (HIGH - LOW)
    second_slope = steep[:, None] * normal_slope[:, 0]
    found = []
    for frames in biased_frames(normal):
        index = frames.at
        if dim == 2:
            slope, sign = np.stack([normal_slope, _QUARTER @ normal_slope], axis=2), 0.0
        else:
            slope = _biased_slope(normal[index], normal_slope[index], frames.rotation, frames.bias)
            sign = (-1.0, 1.0)[frames.bias]
        found.append(MovingFrames(*frames, slope, sign * second_slope[index]))
    return found


def random_frames(normal: Array, rng: np.random.Generator) -> Array:
    """R (n, dim, dim) with random tangents to unit normals (n, dim); in 2D there is only one choice."""
    n, dim = normal.shape
    if dim == 2:
        return _flat(normal)
    some = rng.standard_normal((n, 3))
    some -= (some * normal).sum(axis=1, keepdims=True) * normal
    first = some / np.linalg.norm(some, axis=1, keepdims=True)
    return np.stack([normal, first, np.cross(normal, first)], axis=-1)


def _towards_second(normal: Array) -> Array:
    """s (n,) in [0, 1]: the blend from the first bias to the second."""
    return np.clip((normal[:, 0] ** 2 - LOW) / (HIGH - LOW), 0.0, 1.0)


def _smooth(s: Array) -> Array:
    return s**3 * (6 * s**2 - 15 * s + 10)


def _flat(normal: Array) -> Array:
    return np.stack([normal, normal @ _QUARTER.T], axis=-1)


def _biased(normal: Array, axis: int) -> Array:
    """R (m, 3, 3)."""
    across = np.cross(normal, np.eye(3)[axis])
    first = across / np.linalg.norm(across, axis=1)[:, None]
    return np.stack([normal, first, np.cross(normal, first)], axis=-1)


def _biased_slope(normal: Array, normal_slope: Array, rotation: Array, axis: int) -> Array:
    """dR/dz (m, 3, 3, 3)."""
    bias, first = np.eye(3)[axis], rotation[:, :, 1]
    length = np.linalg.norm(np.cross(normal, bias), axis=1)[:, None, None]
    across_slope = _cross_columns(normal_slope, bias)
    along = np.einsum("na,nac->nc", first, across_slope)
    first_slope = (across_slope - first[:, :, None] * along[:, None, :]) / length
    second_slope = _cross_columns(normal_slope, first) - _cross_columns(first_slope, normal)
    return np.stack([normal_slope, first_slope, second_slope], axis=2)


def _cross_columns(slope: Array, vector: Array) -> Array:
    """dv/dz_c x vector for dv/dz (m, 3, 3), column by column; vector: (3,) or (m, 3)."""
    return np.cross(slope, np.broadcast_to(vector, slope.shape[:2])[:, :, None], axis=1)
