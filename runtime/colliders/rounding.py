"""Rounded convex corners: exact distances outside, C1 at every depth.

The distance to a box rounded by r has kinks on its inner medial axis, from depth r on, where a penetrating surface node
would make Newton cycle. Here the corner of every level set has a positive radius: at depth d the level set is the box
shrunk by d, with corners rounded by

    R(d) = r - d                    outside (d <= 0), the exact offset surface
    R(d) = r - d + d^2 / (2 r)      for 0 <= d <= r
    R(d) = r / 2                    deeper.

With face distances q_i, the depth of a point solves  sum_i max(q_i + d + R(d), 0)^2 = R(d)^2.  The result is
the exact signed distance outside, on the surface, and wherever a face is nearest by more than R; within R of
the medial axis it is smaller in magnitude than the exact depth by at most (1 - 1/sqrt(m)) R for m faces.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import SdfDerivatives

# Newton on a smooth monotone scalar equation with bisection as a fallback: 6 steps are typical.
_MAX_ITERATIONS = 60


def _radius(d: Array, r: float) -> tuple[Array, Array, Array]:
    """R(d), R'(d), R''(d)."""
    t = np.clip(d, 0.0, r)
    outside = np.minimum(d, 0.0)
    first = np.where(d > r, 0.0, -1.0 + t / r)
    second = np.where((d > 0) & (d < r), 1.0 / r, 0.0)
    return r - t + t**2 / (2 * r) - outside, first, second


def _depth(q: Array, r: float) -> Array:
    """The root d (n,) of sum_i max(q_i + d + R(d), 0)^2 = R(d)^2."""
    d: Array = r - np.linalg.norm(np.maximum(q + r, 0.0), axis=1)  # exact outside, where d is negative
    inside = np.flatnonzero(d > 0)
    if inside.size == 0:
        return d
    q = q[inside]
    low, high = np.zeros(inside.size), -q.max(axis=1)
    x = high.copy()
    for _ in range(_MAX_ITERATIONS):
        radius, slope, _curvature = _radius(x, r)
        u = np.maximum(q + (x + radius)[:, None], 0.0)
        residual = (u**2).sum(axis=1) - radius**2
        low = np.where(residual < 0, x, low)
        high = np.where(residual >= 0, x, high)
        newton = x - residual / (2 * (u.sum(axis=1) * (1 + slope) - radius * slope))
        step = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high)) - x
        x = x + step
        if np.abs(step).max() < 1e-15 * (1.0 + np.abs(x).max()):
            break
    d[inside] = x
    return d


def rounded_corner_value(q: Array, rounding: float) -> Array:
    """Signed distance (n,) to the rounded intersection of orthogonal faces, from face distances q (n, m)."""
    return -_depth(q, rounding)


def rounded_corner(q: Array, rounding: float) -> SdfDerivatives:
    """As `rounded_corner_value`, with its derivatives with respect to q: (n,), (n, m), (n, m, m)."""
    d = _depth(q, rounding)
    radius, slope, curvature = _radius(d, rounding)
    u = np.maximum(q + (d + radius)[:, None], 0.0)
    active = (u > 0).astype(float)
    # F = -d by implicit differentiation: dF/dq = u / D with D = sum(u) (1 + R') - R R'.
    total = u.sum(axis=1)
    denominator = total * (1 + slope) - radius * slope
    gradient = u / denominator[:, None]
    u_q = active[:, :, None] * (np.eye(q.shape[1]) - ((1 + slope)[:, None] * gradient)[:, None, :])
    denominator_q = (1 + slope)[:, None] * u_q.sum(axis=1)
    denominator_q -= (total * curvature - slope**2 - radius * curvature)[:, None] * gradient
    hessian = (u_q - gradient[:, :, None] * denominator_q[:, None, :]) / denominator[:, None, None]
    return SdfDerivatives(-d, gradient, hessian)


def smooth_abs(x: Array, width: float) -> tuple[Array, Array, Array]:
    """|x| made C2 within `width` of zero by an even quartic: value, first, second derivative, shaped as x."""
    t = np.clip(x / width, -1.0, 1.0)
    inside = np.abs(x) < width
    value = np.where(inside, width * (3.0 + 6.0 * t**2 - t**4) / 8.0, np.abs(x))
    return value, (3.0 * t - t**3) / 2.0, np.where(inside, 1.5 * (1.0 - t**2) / width, 0.0)
