"""The registry of collider kinds: what a `[[colliders]]` table of an experiment may be, told apart by its `shape`.

A new kind is a file of this folder (see `__init__.py`) and its table in `KINDS`. Unions and differences stand here, as
their parts are tables of any kind.
"""

from __future__ import annotations

from functools import reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

from pydantic import Field

from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.combine import SmoothDifference, SmoothUnion
from softprint.runtime.colliders.kinds.box import BoxSpec
from softprint.runtime.colliders.kinds.cone import CapsuleSpec, ConeSpec
from softprint.runtime.colliders.kinds.cylinder import CylinderSpec
from softprint.runtime.colliders.kinds.library import LibrarySpec
from softprint.runtime.colliders.kinds.mesh import MeshSpec
from softprint.runtime.colliders.kinds.plane import PlaneSpec
from softprint.runtime.colliders.kinds.polygon import PolygonSpec
from softprint.runtime.colliders.kinds.sphere import SphereSpec
from softprint.runtime.colliders.kinds.table import ColliderTable, Length, Tables


class UnionSpec(ColliderTable):
    """The smooth union of its parts."""

    shape: Literal["union"]
    parts: Annotated[list[ColliderSpec], Field(min_length=1)]
    blend: Length = Field(description="width of the fillet where parts meet")

    examples: ClassVar[Tables] = (
        {
            "shape": "union",
            "parts": [
                {"shape": "box", "half_extents": [0.4, 0.2, 0.2]},
                {"shape": "sphere", "radius": 0.2, "position": [0.0, 0.0, 0.3]},
            ],
            "blend": 0.1,
        },
        {
            "shape": "union",
            "parts": [
                {"shape": "circle", "radius": 0.3},
                {"shape": "box", "half_extents": [0.1, 0.4], "rotation": 0.5},
            ],
            "blend": 0.1,
        },
    )

    def make(self, name: str, base_dir: Path) -> SmoothUnion:
        """See `ColliderTable`."""
        return SmoothUnion([build_collider(part, base_dir) for part in self.parts], self.blend, name)


class DifferenceSpec(ColliderTable):
    """`base` with every one of `parts` cut away."""

    shape: Literal["difference"]
    base: ColliderSpec
    parts: Annotated[list[ColliderSpec], Field(min_length=1)]
    blend: Length = Field(description="width over which the cut's edges are rounded")

    examples: ClassVar[Tables] = (
        {
            "shape": "difference",
            "base": {"shape": "box", "half_extents": [0.4, 0.4, 0.3]},
            "parts": [{"shape": "sphere", "radius": 0.3, "position": [0.0, 0.1, 0.3]}],
            "blend": 0.1,
        },
        {
            "shape": "difference",
            "base": {"shape": "circle", "radius": 0.4},
            "parts": [{"shape": "circle", "radius": 0.3, "position": [0.3, 0.0]}],
            "blend": 0.1,
        },
    )

    def make(self, name: str, base_dir: Path) -> SmoothDifference:
        """See `ColliderTable`."""
        parts = [build_collider(part, base_dir) for part in self.parts]
        return SmoothDifference(build_collider(self.base, base_dir), parts, self.blend, name)


#: The table of every kind, in the order in which `softprint keys` lists them.
KINDS: tuple[type[ColliderTable], ...] = (
    SphereSpec,
    BoxSpec,
    CapsuleSpec,
    ConeSpec,
    CylinderSpec,
    PlaneSpec,
    PolygonSpec,
    MeshSpec,
    LibrarySpec,
    UnionSpec,
    DifferenceSpec,
)

if TYPE_CHECKING:
    ColliderSpec = ColliderTable
else:
    ColliderSpec = Annotated[reduce(or_, KINDS), Field(discriminator="shape")]

UnionSpec.model_rebuild()
DifferenceSpec.model_rebuild()


def shape_names(kind: type[ColliderTable]) -> tuple[str, ...]:
    """What a kind is called in experiment files."""
    return get_args(kind.model_fields["shape"].annotation)
