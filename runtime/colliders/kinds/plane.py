"""The half-space."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import ColliderBase, SdfDerivatives
from softprint.runtime.colliders.kinds.table import ColliderTable, Tables, Vector
from softprint.runtime.errors import SoftprintError


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


class PlaneSpec(ColliderTable):
    """The half-space behind `normal` (2 or 3 numbers) through the origin, or through `position`."""

    shape: Literal["plane"]
    normal: Annotated[Vector, Field(min_length=2, max_length=3)]

    examples: ClassVar[Tables] = (
        {"shape": "plane", "normal": [1.0, 2.0, 3.0]},
        {"shape": "plane", "normal": [1.0, 2.0]},
    )

    def make(self, name: str, base_dir: Path) -> Plane:
        """See `ColliderTable`."""
        return Plane(self.normal, name)
