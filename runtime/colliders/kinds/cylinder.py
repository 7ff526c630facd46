"""The cylinder with rounded rims."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import ColliderBase, SdfDerivatives, norm_derivatives
from softprint.runtime.colliders.kinds.table import ColliderTable, Length, Tables, positive, rounding_radius
from softprint.runtime.colliders.rounding import rounded_corner, smooth_abs


class Cylinder(ColliderBase):
    """Cylinder about the z axis, centred at the origin, with rims rounded by `rounding` [m].

    A rounded rectangle in the half-plane (distance from the axis, height); see `rounding.py`.
    """

    def __init__(
        self, radius: float, half_height: float, rounding: float | None = None, name: str = "cylinder"
    ) -> None:
        self.name = name
        self.radius = positive(radius, f"the radius of collider '{name}'")
        self.half_height = positive(half_height, f"the half height of collider '{name}'")
        self.rounding = rounding_radius(rounding, min(self.radius, self.half_height), f"collider '{name}'")
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


class CylinderSpec(ColliderTable):
    """A cylinder about the z axis, centred at the origin, with rounded rims."""

    shape: Literal["cylinder"]
    radius: Length
    half_height: Length
    rounding: Length | None = Field(
        None, description="radius of the rims; 10 % of the smaller extent if absent"
    )

    examples: ClassVar[Tables] = ({"shape": "cylinder", "radius": 0.3, "half_height": 0.4},)

    def make(self, name: str, base_dir: Path) -> Cylinder:
        """See `ColliderTable`."""
        return Cylinder(self.radius, self.half_height, self.rounding, name)
