"""The content of a picture: a body or a surface, values to colour it by, marks, and colliders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from softprint.runtime.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class Marks:
    """Nodes (n,) to mark, all in one colour, under one name in the legend."""

    name: str
    nodes: IntArray
    colour: str


@dataclass(frozen=True, eq=False)
class Scene:
    """A picture to be drawn.

    points: (n, dim) [m]; facets: (f, dim) the visible surface; cells: (c, 3) triangles that fill a 2D body; values:
    (n,) to colour by, named ``label``; solids: (vertices, facets) of colliders in the world; edges: whether to show the
    edges of the mesh.
    """

    title: str
    points: Array
    facets: IntArray
    cells: IntArray | None = None
    values: Array | None = None
    label: str = ""
    marks: Sequence[Marks] = ()
    solids: Sequence[tuple[Array, IntArray]] = ()
    edges: bool = False
    colour: str | None = None

    @property
    def dim(self) -> int:
        return int(self.points.shape[1])
