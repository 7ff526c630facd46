"""The `[[colliders]]` tables of an experiment file: one pydantic model for each shape, told apart by `shape`.

Lengths are metres, angles radians. `position` and `rotation` place a shape in its collider's own coordinates,
which is how the parts of a union or a difference find their places.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from runtime.errors import SoftprintError
from runtime.experiment.section import Positive, Section
from runtime.shapes import find_shape

Vector = list[float]
Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _ColliderSpec(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: str = Field("", description="what scenes and corrections call it; parts of a combination need none")
    position: Vector | None = Field(None, description="place in the collider's coordinates [m]")
    rotation: Vector | float | None = Field(None, description="an angle in 2D, axis times angle in 3D [rad]")


class SphereSpec(_ColliderSpec):
    """A ball in 3D (`sphere`) or 2D (`circle`) about the origin."""

    shape: Literal["sphere", "circle"]
    radius: Length


class BoxSpec(_ColliderSpec):
    """A box (3 half extents) or rectangle (2) about the origin with rounded edges."""

    shape: Literal["box"]
    half_extents: Annotated[list[Length], Field(min_length=2, max_length=3)]
    rounding: Length | None = Field(
        None, description="radius of the edges; 10 % of the smallest half extent if absent"
    )


class CapsuleSpec(_ColliderSpec):
    """All points within `radius` of the segment from `start` to `end`, in 2D or 3D."""

    shape: Literal["capsule"]
    start: Annotated[Vector, Field(min_length=2, max_length=3)]
    end: Annotated[Vector, Field(min_length=2, max_length=3)]
    radius: Length


class ConeSpec(_ColliderSpec):
    """A blunt cone: the convex hull of two balls, in 2D or 3D."""

    shape: Literal["cone"]
    start: Annotated[Vector, Field(min_length=2, max_length=3)]
    end: Annotated[Vector, Field(min_length=2, max_length=3)]
    start_radius: Length
    end_radius: Length


class CylinderSpec(_ColliderSpec):
    """A cylinder about the z axis, centred at the origin, with rounded rims."""

    shape: Literal["cylinder"]
    radius: Length
    half_height: Length
    rounding: Length | None = Field(
        None, description="radius of the rims; 10 % of the smaller extent if absent"
    )


class PlaneSpec(_ColliderSpec):
    """The half-space behind `normal` (2 or 3 numbers) through the origin, or through `position`."""

    shape: Literal["plane"]
    normal: Annotated[Vector, Field(min_length=2, max_length=3)]


class PolygonSpec(_ColliderSpec):
    """A 2D polygon, given by its vertices here or in a text file of two columns, with rounded corners."""

    shape: Literal["polygon"]
    vertices: list[Annotated[Vector, Field(min_length=2, max_length=2)]] | None = None
    file: Path | None = Field(None, description="relative to the experiment file")
    scale: Length = 1.0
    rounding: Annotated[float, Field(ge=0)] = Field(
        0.0, description="fillet radius of every corner, inner ones too"
    )
    resolution: Annotated[int, Field(ge=8, le=2048)] = Field(
        96, description="grid cells along the longest side"
    )

    @model_validator(mode="after")
    def _one_source(self) -> PolygonSpec:
        if (self.vertices is None) == (self.file is None):
            raise ValueError("give either `vertices` or `file`")
        return self


class MeshSpec(_ColliderSpec):
    """A closed triangle mesh (STL, OBJ or PLY), turned into a smooth signed distance on a grid."""

    shape: Literal["mesh"]
    file: Path = Field(description="relative to the experiment file")
    scale: Length = Field(
        1.0, description="metres for each unit of the file: 0.001 for a file in millimetres"
    )
    resolution: Annotated[int, Field(ge=8, le=256)] = Field(
        48, description="grid cells along the longest side"
    )


class LibrarySpec(_ColliderSpec):
    """A solid of the library: `docs/collider_library.png` shows them all with their names."""

    shape: Literal["library"]
    entry: str = Field("", description="which of the library's shapes; the collider's own name if absent")
    size: Length = Field(description="half of its largest extent [m]")
    resolution: Annotated[int, Field(ge=8, le=256)] = Field(
        48, description="grid cells along the longest side"
    )

    @model_validator(mode="after")
    def _is_there(self) -> LibrarySpec:
        try:
            find_shape(self.entry_name)
        except SoftprintError as error:
            raise ValueError(str(error)) from None
        return self

    @property
    def entry_name(self) -> str:
        return self.entry or self.name


class LibraryTable(Section):
    """`[library]`: makes every shape of the library a collider of the experiment, called by the shape's name."""

    size: Positive = Field(description="half of the largest extent of every shape [m]")
    shapes: tuple[str, ...] = Field(
        (), description="the truth is made with these only; with all if there are none"
    )
    resolution: Annotated[int, Field(ge=8, le=256)] = Field(
        48, description="grid cells along the longest side of a shape"
    )

    def spec(self, name: str) -> LibrarySpec:
        """The shape of that name as a collider."""
        return LibrarySpec(shape="library", name=name, size=self.size, resolution=self.resolution)


class UnionSpec(_ColliderSpec):
    """The smooth union of its parts."""

    shape: Literal["union"]
    parts: Annotated[list[ColliderSpec], Field(min_length=1)]
    blend: Length = Field(description="width of the fillet where parts meet")


class DifferenceSpec(_ColliderSpec):
    """`base` with every one of `parts` cut away."""

    shape: Literal["difference"]
    base: ColliderSpec
    parts: Annotated[list[ColliderSpec], Field(min_length=1)]
    blend: Length = Field(description="width over which the cut's edges are rounded")


ColliderSpec = Annotated[
    SphereSpec
    | BoxSpec
    | CapsuleSpec
    | ConeSpec
    | CylinderSpec
    | PlaneSpec
    | PolygonSpec
    | MeshSpec
    | LibrarySpec
    | UnionSpec
    | DifferenceSpec,
    Field(discriminator="shape"),
]

UnionSpec.model_rebuild()
DifferenceSpec.model_rebuild()
