"""What the `[[colliders]]` table of every kind has: its keys, and how a collider is made of them.

Lengths are metres, angles radians. `position` and `rotation` place a shape in its collider's own coordinates,
which is how the parts of a union or a difference find their places.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from softprint.runtime.colliders.collider import Collider
from softprint.runtime.errors import SoftprintError

Vector = list[float]
Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Tables = tuple[Mapping[str, Any], ...]

# Rounding where none is given, as a share of the smallest half extent.
DEFAULT_ROUNDING = 0.1


class ColliderTable(BaseModel, ABC):
    """One kind of collider. `shape` is a `Literal` of the names that it has in experiment files.

    examples: tables of this kind that between them show every dimension it comes in, about one metre large; every test
    that colliders have to pass builds them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    examples: ClassVar[Tables]

    # Motion files have a group of this name.
    name: str = Field(
        "",
        pattern=r"^([A-Za-z0-9][A-Za-z0-9_. -]*)?$",
        max_length=80,
        description="what scenes and corrections call it; parts of a combination need none",
    )
    position: Vector | None = Field(None, description="place in the collider's coordinates [m]")
    rotation: Vector | float | None = Field(None, description="an angle in 2D, axis times angle in 3D [rad]")
    shape: str

    @abstractmethod
    def make(self, name: str, base_dir: Path) -> Collider:
        """The collider, called `name` and not yet placed; files are looked for relative to `base_dir`. Raises
        SoftprintError for values that make no solid, and for files that are missing or unusable."""


def positive(value: float, what: str) -> float:
    """The length, or a SoftprintError that says what is none."""
    if not (np.isfinite(value) and value > 0):
        raise SoftprintError(f"{what} must be a positive number of metres, not {value}")
    return float(value)


def rounding_radius(rounding: float | None, smallest: float, what: str) -> float:
    """The radius of rounded edges [m]; smallest: half extent of the solid, which bounds it."""
    radius = (
        DEFAULT_ROUNDING * smallest if rounding is None else positive(rounding, f"the rounding of {what}")
    )
    if radius > smallest:
        raise SoftprintError(
            f"the rounding of {what}, {radius} m, is larger than its smallest half extent, {smallest} m"
        )
    return radius
