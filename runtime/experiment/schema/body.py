"""The `[body]` table: rest mesh, handles, material, cubature and contact samples of the soft body."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from softprint.runtime.elasticity.materials import MATERIALS
from softprint.runtime.experiment.schema.section import Box, Count, Name, Positive, Section, Vector

Poisson = Annotated[float, Field(gt=-1, lt=0.5)]
PointCount = Annotated[int, Field(ge=0)]
if TYPE_CHECKING:
    MaterialModel = str
else:
    MaterialModel = Literal[tuple(MATERIALS)]
Segment = Annotated[tuple[Vector, Vector], Field(description="from one point to another [m]")]


class FrameSpec(Section):
    """A rigid frame: all nodes of the rest mesh in a box, or near the segments of a bone, move together."""

    name: Name = Field(description="the name of the frame in scenes and springs")
    box: Box | None = None
    segments: Annotated[tuple[Segment, ...], Field(min_length=1)] | None = Field(
        None, description="the segments of a bone; with `radius`, in place of a box"
    )
    radius: Positive | None = Field(None, description="radius of the bone about its segments [m]")

    @model_validator(mode="after")
    def _one_region(self) -> FrameSpec:
        if (self.box is None) == (self.segments is None):
            raise ValueError("give either `box`, or `segments` with their `radius`")
        if (self.segments is None) != (self.radius is None):
            raise ValueError("`segments` and `radius` go together")
        return self


class HandlesSpec(Section):
    """`[body.handles]`: the degrees of freedom of the reduced body."""

    points: PointCount | tuple[Vector, ...] = Field(
        description="how many point handles to place, farthest apart on the surface; "
        "or a list of positions [m], each moved to its nearest node"
    )
    frames: tuple[FrameSpec, ...] = Field(
        (), description="rigid frames, each with a name and a box, or with segments and their radius [m]"
    )
    subspace: Literal["biharmonic_coordinates", "linear_blend_skinning"] = Field(
        "biharmonic_coordinates",
        description="how handles move the nodes: biharmonic generalised barycentric coordinates, or a mean of the "
        "frames with bounded biharmonic weights, for skeletons without points",
    )
    hold: Literal["projection", "mass", "nodes"] = Field(
        "mass",
        description="how a state is held while the rest settles: its projection onto the points' columns of the basis "
        "weighted by the masses of the nodes, the plain projection (thesis, chapter 5), or the points' nodes fixed "
        "(chapter 4)",
    )


class MaterialRegionSpec(Section):
    """A part of the body with its own material: the cells whose centroid lies in the box."""

    box: Box
    young: Positive | None = Field(
        None, ge=1e-3, le=1e15, description="Young's modulus [Pa]; that of the body if absent"
    )
    poisson: Poisson | None = Field(None, description="Poisson's ratio; that of the body if absent")
    density: Positive | None = Field(None, description="density; that of the body if absent")


class MaterialSpec(Section):
    """`[body.material]`: hyperelastic solid; plane strain in 2D."""

    model: MaterialModel = Field("invertible_neo_hookean", description="strain energy density")
    young: Positive = Field(ge=1e-3, le=1e15, description="Young's modulus [Pa]")
    poisson: Poisson = Field(description="Poisson's ratio, between -1 and 0.5, exclusive")
    density: Positive = Field(1000.0, description="density [kg/m^3] (kg/m^2 in 2D)")
    regions: tuple[MaterialRegionSpec, ...] = Field(
        (), description="parts of another material; later ones override earlier ones"
    )


class CubatureSpec(Section):
    """`[body.cubature]`: where the reduced elastic energy is integrated (thesis 3.7.2)."""

    points_per_row: Count = Field(10, description="cubature cells for each row of the subspace basis")


class SurfaceSpec(Section):
    """`[body.surface]`: the points at which the runtime evaluates contact."""

    samples: Count = Field(3000, description="limit of contact points")


class BodySpec(Section):
    """`[body]`: a soft body and its reduced model."""

    mesh: Path = Field(
        description="tetrahedra or triangles in any format of meshio, relative to the experiment file"
    )
    handles: HandlesSpec
    material: MaterialSpec
    cubature: CubatureSpec = CubatureSpec()
    surface: SurfaceSpec = SurfaceSpec()
