"""The ball, and the circle."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import ColliderBase, SdfDerivatives, norm_derivatives
from softprint.runtime.colliders.kinds.table import ColliderTable, Length, Tables, positive


class Sphere(ColliderBase):
    """Ball of `radius` [m] about the origin; a circle for dim = 2. Exact: |z| - radius."""

    def __init__(self, radius: float, dim: int = 3, name: str = "sphere") -> None:
        self.name = name
        self.radius = positive(radius, f"the radius of collider '{name}'")
        self.upper = np.full(dim, self.radius)
        self.lower = -self.upper

    def sdf(self, z: Array) -> Array:
        return np.asarray(np.linalg.norm(z, axis=1) - self.radius)

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        d = norm_derivatives(z)
        return d._replace(value=d.value - self.radius)


class SphereSpec(ColliderTable):
    """A ball in 3D (`sphere`) or 2D (`circle`) about the origin."""

    shape: Literal["sphere", "circle"]
    radius: Length

    examples: ClassVar[Tables] = (
        {"shape": "sphere", "radius": 0.4},
        {"shape": "circle", "radius": 0.4},
    )

    def make(self, name: str, base_dir: Path) -> Sphere:
        """See `ColliderTable`."""
        return Sphere(self.radius, dim=2 if self.shape == "circle" else 3, name=name)
