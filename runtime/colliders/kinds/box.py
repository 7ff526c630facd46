"""The box, and the rectangle, with rounded edges."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import ColliderBase, SdfDerivatives
from softprint.runtime.colliders.kinds.table import ColliderTable, Length, Tables, positive, rounding_radius
from softprint.runtime.colliders.rounding import rounded_corner, rounded_corner_value, smooth_abs
from softprint.runtime.errors import SoftprintError


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
        smallest = positive(float(self.upper.min()), f"each half extent of collider '{name}'")
        self.lower = -self.upper
        self.rounding = rounding_radius(rounding, smallest, f"collider '{name}'")

    def sdf(self, z: Array) -> Array:
        return rounded_corner_value(smooth_abs(z, self.rounding)[0] - self.upper, self.rounding)

    def sdf_derivatives(self, z: Array) -> SdfDerivatives:
        absolute, slope, curvature = smooth_abs(z, self.rounding)
        f = rounded_corner(absolute - self.upper, self.rounding)
        hessian = f.hessian * slope[:, :, None] * slope[:, None, :]
        diagonal = np.arange(self.dim)
        hessian[:, diagonal, diagonal] += f.gradient * curvature
        return SdfDerivatives(f.value, f.gradient * slope, hessian)


class BoxSpec(ColliderTable):
    """A box (3 half extents) or rectangle (2) about the origin with rounded edges."""

    shape: Literal["box"]
    half_extents: Annotated[list[Length], Field(min_length=2, max_length=3)]
    rounding: Length | None = Field(
        None, description="radius of the edges; 10 % of the smallest half extent if absent"
    )

    examples: ClassVar[Tables] = (
        {"shape": "box", "half_extents": [0.3, 0.4, 0.5]},
        {"shape": "box", "half_extents": [0.3, 0.4], "rounding": 0.1},
    )

    def make(self, name: str, base_dir: Path) -> Box:
        """See `ColliderTable`."""
        return Box(self.half_extents, self.rounding, name)
