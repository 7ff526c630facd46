"""Polygons as a kind of collider (`runtime/colliders/sampled/polygon.py`)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from softprint.runtime.colliders.kinds.from_file import FromFile
from softprint.runtime.colliders.kinds.table import Tables, Vector
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.colliders.sampled.polygon import load_polygon, polygon_collider


class PolygonSpec(FromFile):
    """A 2D polygon, given by its vertices here or in a text file of two columns, with rounded corners."""

    shape: Literal["polygon"]
    vertices: list[Annotated[Vector, Field(min_length=2, max_length=2)]] | None = None
    file: Path | None = Field(None, description="relative to the experiment file")
    rounding: Annotated[float, Field(ge=0)] = Field(
        0.0, description="fillet radius of every corner, inner ones too"
    )
    resolution: Annotated[int, Field(ge=8, le=2048)] = Field(
        96, description="grid cells along the longest side"
    )

    examples: ClassVar[Tables] = (
        {"shape": "polygon", "vertices": [[-0.4, -0.3], [0.4, -0.3], [0.0, 0.4]], "rounding": 0.05},
    )

    @model_validator(mode="after")
    def _one_source(self) -> PolygonSpec:
        if (self.vertices is None) == (self.file is None):
            raise ValueError("give either `vertices` or `file`")
        return self

    def make(self, name: str, base_dir: Path) -> GridCollider:
        """See `ColliderTable`."""
        vertices = np.array(self.vertices) if self.file is None else load_polygon(base_dir / self.file)
        return polygon_collider(self.in_metres(vertices), self.rounding, self.resolution, name)
