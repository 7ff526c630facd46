"""The `[library]` table of an experiment file. What a `[[colliders]]` table may be: `runtime/colliders/kinds/`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from softprint.runtime.colliders.kinds.library import LibrarySpec
from softprint.runtime.colliders.kinds.mesh import MeshSpec
from softprint.runtime.experiment.schema.section import Positive, Section


class LibraryTable(Section):
    """`[library]`: makes every shape of the library a collider of the experiment, under the shape's name; and every
    mesh file of one's own, under the name of the file without its ending."""

    size: Positive = Field(description="half of the largest extent of every shape [m]")
    shapes: tuple[str, ...] = Field(
        (),
        description="the truth is made with these shapes of the library only; if empty, with all, or with "
        "none where there are meshes",
    )
    resolution: Annotated[int, Field(ge=8, le=256)] = Field(
        48, description="grid cells along the longest side of a shape"
    )
    meshes: tuple[str, ...] = Field(
        (),
        description='shapes of one\'s own to train on: STL, OBJ or PLY files, or patterns ("shapes/*.stl")',
    )
    validation: tuple[str, ...] = Field(
        (),
        description="files or patterns of meshes that models are chosen by; if empty, every fifth of `meshes`",
    )
    test: tuple[str, ...] = Field(
        (), description="files or patterns of meshes that models are judged by, and nothing else"
    )
    unit: Literal["m", "cm", "mm", "in"] | None = Field(
        None, description="of one's own meshes, which then keep their size, instead of `size`"
    )

    def spec(self, name: str) -> LibrarySpec:
        """The shape of that name as a collider."""
        return LibrarySpec(shape="library", name=name, size=self.size, resolution=self.resolution)

    def mesh_spec(self, file: Path) -> MeshSpec:
        """A mesh of one's own as a collider, centred."""
        length = {"size": self.size} if self.unit is None else {"unit": self.unit}
        table = {"shape": "mesh", "name": file.stem, "file": file, "centre": True, **length}
        return MeshSpec.model_validate({**table, "resolution": self.resolution})
