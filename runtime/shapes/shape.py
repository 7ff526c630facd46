"""An entry of the library: a field, its name, and known properties of its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.io.files import content_hash
from softprint.runtime.shapes.solid import Field

# Distances are hashed to this number of digits relative to the shape's size: processors differ in the last digits.
_DIGITS = 6


@dataclass(frozen=True)
class Shape:
    """A solid in units of its own.

    line: a short description; reach: half extents of a box about the origin that contains it; field: negative
    inside; holes: through-holes, counted as handles of its surfaces (the sum of their genera); voids: closed cavities;
    exact: whether the field is the signed distance, inside and outside; cells: along the longest side of the grid for
    its triangles; edges and corners are accurate to about one cell.
    """

    name: str
    line: str
    reach: tuple[float, float, float]
    field: Field
    holes: int = 0
    voids: int = 0
    exact: bool = False
    cells: int = 64

    @property
    def euler_characteristic(self) -> int:
        """V - E + F of its surface: 2 - 2 g summed over the outer surface and those of the voids."""
        return 2 * (1 + self.voids) - 2 * self.holes

    @property
    def formula_hash(self) -> str:
        """Identifies the solid by its field at points around it, and by the grid of its triangles."""
        reach = np.array(self.reach, dtype=float)
        points = np.random.default_rng(0).uniform(-1.2 * reach, 1.2 * reach, (64, 3))
        field = np.round(self.field(points) / reach.max(), _DIGITS) + 0.0  # of -0.0 too
        return content_hash({"reach": reach, "field": field, "cells": self.cells, "exact": str(self.exact)})
