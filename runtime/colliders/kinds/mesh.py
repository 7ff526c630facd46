"""Closed triangle meshes as a kind of collider (`runtime/colliders/surface_mesh/mesh_collider.py`)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from softprint.runtime.colliders.kinds.from_file import FromFile
from softprint.runtime.colliders.kinds.table import Tables
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.colliders.surface_mesh.mesh_collider import placed_mesh_collider


class MeshSpec(FromFile):
    """A closed triangle mesh (STL, OBJ or PLY), turned into a smooth signed distance on a grid."""

    shape: Literal["mesh"]
    file: Path = Field(description="relative to the experiment file")
    resolution: Annotated[int, Field(ge=8, le=256)] = Field(
        48, description="grid cells along the longest side"
    )

    examples: ClassVar[Tables] = (
        {"shape": "mesh", "file": "block.stl", "scale": 1e-3},
        {"shape": "mesh", "file": "block.stl", "size": 0.4, "centre": True},
    )

    def make(self, name: str, base_dir: Path) -> GridCollider:
        """See `ColliderTable`."""
        return placed_mesh_collider(base_dir / self.file, self.in_metres, self.resolution, name)
