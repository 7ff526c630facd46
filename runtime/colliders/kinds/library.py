"""Shapes of the library as a kind of collider (`runtime/colliders/library.py`)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from softprint.runtime.colliders.kinds.table import ColliderTable, Length, Tables
from softprint.runtime.colliders.library import library_collider
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.shapes import find_shape


class LibrarySpec(ColliderTable):
    """A solid of the library: `docs/collider_library.png` shows them all with their names."""

    shape: Literal["library"]
    entry: str = Field("", description="which of the library's shapes; the collider's own name if absent")
    size: Length = Field(description="half of its largest extent [m]")
    resolution: Annotated[int, Field(ge=8, le=256)] = Field(
        48, description="grid cells along the longest side"
    )

    examples: ClassVar[Tables] = ({"shape": "library", "entry": "torus", "size": 0.5},)

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

    def make(self, name: str, base_dir: Path) -> GridCollider:
        """See `ColliderTable`."""
        return library_collider(self.entry_name, self.size, self.resolution, name)
