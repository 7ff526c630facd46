"""Colliders given by a formula: sphere (circle), box (rectangle), capsule, cone, cylinder, half-space.

Sphere, capsule, cone and half-space are exact signed distances; the kinks of the first three lie on their
centre or axis only. Box and cylinder are rounded and C1 at every depth (see `rounding.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from runtime.arrays import Array
from runtime.colliders import cone_kernels
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
        return np.asarray(np.linalg.norm(z, axis=1) - self.radius)

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


class Cone(ColliderBase):
    """A blunt cone: the convex hull of a ball at `start` and a ball at `end`, in 2D or 3D.

    With the axis e, sin(alpha) = (start_radius - end_radius) / length, y and x the coordinates along and
    across the axis, the side is at  x cos(alpha) + y sin(alpha) - start_radius,  and the ends are spheres.
    C1 everywhere but on the axis.
    """

    def __init__(
        self, start: ArrayLike, end: ArrayLike, start_radius: float, end_radius: float, name: str = "cone"
    ) -> None:
        self.name = name
        self.start, self.end = np.array(start, dtype=float), np.array(end, dtype=float)
        if self.start.shape not in ((2,), (3,)) or self.start.shape != self.end.shape:
            raise SoftprintError(f"collider '{name}': start and end must both have 2 or both have 3 numbers")
        self.start_radius = _positive(start_radius, f"the start radius of collider '{name}'")
        self.end_radius = _positive(end_radius, f"the end radius of collider '{name}'")
        self.length = float(np.linalg.norm(self.end - self.start))
        if not self.length > abs(start_radius - end_radius):
            raise SoftprintError(
                f"collider '{name}': one end's ball contains the other's: the distance from start to end, "
                f"{self.length} m, must exceed the difference of the radii"
            )
        self.axis = (self.end - self.start) / self.length
        self.sin = (self.start_radius - self.end_radius) / self.length
        self.cos = float(np.sqrt(1.0 - self.sin**2))
        self.lower = np.minimum(self.start - start_radius, self.end - end_radius)
        self.upper = np.maximum(self.start + start_radius, self.end + end_radius)

    def sdf(self, z: Array) -> Array:
        return cone_kernels.values(np.ascontiguousarray(z), self._cones, 1.0)

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        return SdfDerivatives(*cone_kernels.derivatives(np.ascontiguousarray(z), self._cones, 1.0))

    @cached_property
    def _cones(self) -> cone_kernels.Cones:
        """What the kernels take: a union of this one, where there is nothing to blend."""
        return side_by_side([self])


class Capsule(Cone):
    """All points within `radius` of the segment from `start` to `end`, in 2D or 3D. Exact."""

    def __init__(self, start: ArrayLike, end: ArrayLike, radius: float, name: str = "capsule") -> None:
        super().__init__(start, end, radius, radius, name)


def side_by_side(cones: Sequence[Cone]) -> cone_kernels.Cones:
    """Of p cones: start and axis (p, dim), length, radius at the start, sin and cos (p,)."""
    return (
        np.array([cone.start for cone in cones]),
        np.array([cone.axis for cone in cones]),
        np.array([cone.length for cone in cones]),
        np.array([cone.start_radius for cone in cones]),
        np.array([cone.sin for cone in cones]),
        np.array([cone.cos for cone in cones]),
    )


class Cylinder(ColliderBase):
    """Cylinder about the z axis, centred at the origin, with rims rounded by `rounding` [m].

    A rounded rectangle in the half-plane (distance from the axis, height); see `rounding.py`.
    """

    def __init__(
        self, radius: float, half_height: float, rounding: float | None = None, name: str = "cylinder"
    ) -> None:
        self.name = name
        self.radius = _positive(radius, f"the radius of collider '{name}'")
        self.half_height = _positive(half_height, f"the half height of collider '{name}'")
        self.rounding = _rounding(rounding, min(self.radius, self.half_height), f"collider '{name}'")
        self.upper = np.array([self.radius, self.radius, self.half_height])
        self.lower = -self.upper

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        radial = norm_derivatives(z[:, :2])
        profile = np.column_stack([radial.value, z[:, 2]])
        absolute, slope, curvature = smooth_abs(profile, self.rounding)
        f = rounded_corner(absolute - [self.radius, self.half_height], self.rounding)
        # Gradients (n, 2, 3) and Hessians of the two profile coordinates after smooth_abs, with respect to z.
        inner = np.zeros((len(z), 2, 3))
        inner[:, 0, :2] = slope[:, :1] * radial.gradient
        inner[:, 1, 2] = slope[:, 1]
        hessian = np.einsum("nab,nai,nbj->nij", f.hessian, inner, inner)
        # On the axis slope / rho tends to 3 / (2 w), while norm_derivatives has 1/rho = 0 there.
        round_off = radial.value < 1e-12 * self.rounding
        around = np.where(
            round_off[:, None, None],
            1.5 / self.rounding * np.eye(2),
            curvature[:, 0, None, None] * radial.gradient[:, :, None] * radial.gradient[:, None, :]
            + slope[:, 0, None, None] * radial.hessian,
        )
        hessian[:, :2, :2] += f.gradient[:, 0, None, None] * around
        hessian[:, 2, 2] += f.gradient[:, 1] * curvature[:, 1]
        return SdfDerivatives(f.value, np.einsum("na,nai->ni", f.gradient, inner), hessian)


class Plane(ColliderBase):
    """The half-space behind the plane through the origin with outward `normal` (dim,). Exact; unbounded."""

    def __init__(self, normal: ArrayLike, name: str = "plane") -> None:
        self.name = name
        normal = np.array(normal, dtype=float)
        length = float(np.linalg.norm(normal))
        if normal.shape not in ((2,), (3,)) or not (np.isfinite(length) and length > 0):
            raise SoftprintError(
                f"collider '{name}': the normal is 2 or 3 numbers, not all zero; got {normal.tolist()}"
            )
        self.normal = normal / length
        self.upper = np.full(normal.size, np.inf)
        self.lower = -self.upper

    def sdf(self, z: Array) -> Array:
        return z @ self.normal

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        n = self.normal
        return SdfDerivatives(z @ n, np.tile(n, (len(z), 1)), np.zeros((len(z), n.size, n.size)))
