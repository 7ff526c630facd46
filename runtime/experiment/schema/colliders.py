"""The `[library]` table of an experiment file. What a `[[colliders]]` table may be: `runtime/colliders/kinds/`."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from softprint.runtime.colliders.kinds.library import LibrarySpec
from softprint.runtime.experiment.schema.section import Positive, Section


class LibraryTable(Section):
    """`[library]`: makes every shape of the library a collider of the experiment, under the shape's name."""

    size: Positive = Field(description="half of the largest extent of every shape [m]")
    shapes: tuple[str, ...] = Field(
        (), description="the truth is made with these shapes only; with all if empty"
    )
    resolution: Annotated[int, Field(ge=8, le=256)] = Field(
        48, description="grid cells along the longest side of a shape"
    )

    def spec(self, name: str) -> LibrarySpec:
        """The shape of that name as a collider."""
        return LibrarySpec(shape="library", name=name, size=self.size, resolution=self.resolution)
