"""Colliders given by a formula: sphere (circle), box (rectangle), capsule, cone, cylinder, half-space.

Sphere, capsule, cone and half-space are exact signed distances; the kinks of the first three lie on their
centre or axis only. Box and cylinder are rounded and C1 at every depth (see `rounding.py`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from runtime.arrays import Array
from runtime.colliders.collider import ColliderBase, SdfDerivatives, norm_derivatives
from runtime.colliders.rounding import rounded_corner, rounded_corner_value, smooth_abs
from runtime.errors import SoftprintError

# Rounding of boxes and cylinders where none is given, as a share of the smallest half extent.
DEFAULT_ROUNDING = 0.1


def _positive(value: float, what: str) -> float:
    if not (np.isfinite(value) and value > 0):
        raise SoftprintError(f"{what} must be a positive number of metres, not {value}")
    return float(value)


def _rounding(rounding: float | None, smallest: float, what: str) -> float:
    radius = (
        DEFAULT_ROUNDING * smallest if rounding is None else _positive(rounding, f"the rounding of {what}")
    )
    if radius > smallest:
        raise SoftprintError(
            f"the rounding of {what}, {radius} m, is larger than its smallest half extent, {smallest} m"
        )
    return radius


class Sphere(ColliderBase):
    """Ball of `radius` [m] about the origin; a circle for dim = 2. Exact: |z| - radius."""

    def __init__(self, radius: float, dim: int = 3, name: str = "sphere") -> None:
        self.name = name
        self.radius = _positive(radius, f"the radius of collider '{name}'")
        self.upper = np.full(dim, self.radius)
        self.lower = -self.upper

    def sdf(self, z: Array) -> Array:
        return np.linalg.norm(z, axis=1) - self.radius

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        d = norm_derivatives(z)
        return d._replace(value=d.value - self.radius)


class Box(ColliderBase):
    """Axis-aligned box about the origin with half_extents (dim,) [m], edges rounded by `rounding` [m].

    The exact distance to the rounded box outside; inside as `rounding.py` says.
    """

    def __init__(self, half_extents: ArrayLike, rounding: float | None = None, name: str = "box") -> None:
        self.name = name
        self.upper = np.array(half_extents, dtype=float)
        if self.upper.shape not in ((2,), (3,)):
            raise SoftprintError(
                f"collider '{name}': half_extents are 2 or 3 numbers, not {self.upper.tolist()}"
            )
        smallest = _positive(float(self.upper.min()), f"each half extent of collider '{name}'")
        self.lower = -self.upper
        self.rounding = _rounding(rounding, smallest, f"collider '{name}'")

    def sdf(self, z: Array) -> Array:
        return rounded_corner_value(smooth_abs(z, self.rounding)[0] - self.upper, self.rounding)

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        absolute, slope, curvature = smooth_abs(z, self.rounding)
        f = rounded_corner(absolute - self.upper, self.rounding)
        hessian = f.hessian * slope[:, :, None] * slope[:, None, :]
        diagonal = np.arange(self.dim)
        hessian[:, diagonal, diagonal] += f.gradient * curvature
        return SdfDerivatives(f.value, f.gradient * slope, hessian)
