"""Closed triangle meshes as a kind of collider (`runtime/colliders/surface_mesh/mesh_collider.py`)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from softprint.runtime.colliders.kinds.table import ColliderTable, Length, Tables
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.colliders.surface_mesh.mesh_collider import load_mesh_collider


class MeshSpec(ColliderTable):
    """A closed triangle mesh (STL, OBJ or PLY), turned into a smooth signed distance on a grid."""

    shape: Literal["mesh"]
    file: Path = Field(description="relative to the experiment file")
    scale: Length = Field(
        1.0, description="metres for each unit of the file: 0.001 for a file in millimetres"
    )
    resolution: Annotated[int, Field(ge=8, le=256)] = Field(
        48, description="grid cells along the longest side"
    )

    examples: ClassVar[Tables] = ({"shape": "mesh", "file": "block.stl", "scale": 1e-3},)

    def make(self, name: str, base_dir: Path) -> GridCollider:
        """See `ColliderTable`."""
        return load_mesh_collider(base_dir / self.file, self.scale, self.resolution, name)
