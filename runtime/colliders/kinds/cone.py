"""Blunt cones and capsules: convex hulls of two balls."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import cone_kernels
from softprint.runtime.colliders.collider import ColliderBase, SdfDerivatives
from softprint.runtime.colliders.kinds.table import ColliderTable, Length, Tables, Vector, positive
from softprint.runtime.errors import SoftprintError


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
        self.start_radius = positive(start_radius, f"the start radius of collider '{name}'")
        self.end_radius = positive(end_radius, f"the end radius of collider '{name}'")
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


class ConeSpec(ColliderTable):
    """A blunt cone: the convex hull of two balls, in 2D or 3D."""

    shape: Literal["cone"]
    start: Annotated[Vector, Field(min_length=2, max_length=3)]
    end: Annotated[Vector, Field(min_length=2, max_length=3)]
    start_radius: Length
    end_radius: Length

    examples: ClassVar[Tables] = (
        {
            "shape": "cone",
            "start": [-0.2, 0.0, 0.0],
            "end": [0.3, 0.2, 0.1],
            "start_radius": 0.2,
            "end_radius": 0.1,
        },
        {"shape": "cone", "start": [-0.2, 0.0], "end": [0.3, 0.2], "start_radius": 0.1, "end_radius": 0.2},
    )

    def make(self, name: str, base_dir: Path) -> Cone:
        """See `ColliderTable`."""
        return Cone(self.start, self.end, self.start_radius, self.end_radius, name)


class CapsuleSpec(ColliderTable):
    """All points within `radius` of the segment from `start` to `end`, in 2D or 3D."""

    shape: Literal["capsule"]
    start: Annotated[Vector, Field(min_length=2, max_length=3)]
    end: Annotated[Vector, Field(min_length=2, max_length=3)]
    radius: Length

    examples: ClassVar[Tables] = (
        {"shape": "capsule", "start": [0.0, 0.0, 0.0], "end": [0.3, 0.2, 0.1], "radius": 0.2},
        {"shape": "capsule", "start": [0.0, 0.0], "end": [0.3, 0.2], "radius": 0.2},
    )

    def make(self, name: str, base_dir: Path) -> Capsule:
        """See `ColliderTable`."""
        return Capsule(self.start, self.end, self.radius, name)
