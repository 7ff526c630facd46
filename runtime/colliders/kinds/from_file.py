"""Where the vertices of a collider's file lie in metres: its unit or its size, and its middle."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.kinds.table import ColliderTable, Length

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


class FromFile(ColliderTable):
    """The keys that shapes from files share. At most one of `scale`, `unit` and `size` is given; the default is 1 m."""

    scale: Length | None = Field(
        None, description="metres for each unit of the file: 0.001 for a file in millimetres; default 1"
    )
    unit: Literal["m", "cm", "mm", "in"] | None = Field(None, description="of the file, instead of `scale`")
    size: Length | None = Field(
        None, description="half of the longest side [m], as of a library shape, instead of `scale`"
    )
    centre: bool = Field(
        False,
        description="whether to move the middle of the bounding box to the origin, about which it turns",
    )

    @model_validator(mode="after")
    def _one_length(self) -> Self:
        given = [name for name in ("scale", "unit", "size") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"give either `{given[0]}` or `{given[1]}`")
        return self

    def in_metres(self, vertices: Array) -> Array:
        """Vertices (n, dim) of the file, in metres and where they belong."""
        lower, upper = vertices.min(axis=0), vertices.max(axis=0)
        moved = vertices - 0.5 * (lower + upper) if self.centre else vertices
        if self.size is not None:
            return moved * (2.0 * self.size / float((upper - lower).max()))
        return moved * (UNITS[self.unit] if self.unit is not None else self.scale or 1.0)
