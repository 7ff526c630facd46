"""What a picture of a file shows: a body or a surface, something it is coloured by, marks, and colliders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from runtime.arrays import Array, IntArray
from runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class Marks:
    """Nodes (n,) to mark, all in one colour, under one name in the legend."""

    name: str
    nodes: IntArray
    colour: str


@dataclass(frozen=True, eq=False)
class Scene:
    """A picture to be drawn.

    points: (n, dim) [m]; facets: (f, dim) the surface that is seen; cells: (c, 3) triangles that fill a body in
    the plane; values: (n,) to colour by, called ``label``; solids: (vertices, facets) of colliders in the world;
    edges: whether the edges of the mesh are worth showing.
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


def draw(path: Path, scene: Scene) -> None:
    """Write the picture as PNG, whole or not at all. SoftprintError where what draws it is not there."""
    if path.suffix.lower() != ".png":
        raise SoftprintError(f"{path}: pictures are written as PNG; call it {path.stem}.png")
    if scene.dim == 2:
        from runtime.drawing.flat import draw_flat

        draw_flat(path, scene)
    else:
        from runtime.drawing.solid import draw_solid

        draw_solid(path, scene)
