"""What a film shows, apart from how it moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.mesh import Mesh

_AXES = "xyz"


class Cut(NamedTuple):
    """A plane on which the coordinate of that axis (0, 1, 2) has that value [m]; what is nearer to the camera is taken
    away."""

    axis: int
    value: float

    @classmethod
    def parse(cls, text: str) -> Cut:
        """`y=0.01`. Raises ValueError."""
        name, _, number = text.replace(" ", "").partition("=")
        value = float(number)
        if len(name) != 1 or name not in _AXES or not isfinite(value):
            raise ValueError(text)
        return cls(_AXES.index(name), value)


@dataclass(frozen=True, eq=False)
class Subject:
    """mesh: the body at rest; nodes: (s,) that are shown; triangles: (t, 3) of them, in 2D those of the inside;
    outline: (o, 2) segments in 2D; solids: of the colliders by name, the middle of the place where each is (dim,),
    vertices (v, dim) in its own coordinates, and facets (f, dim); seen: (m, dim) points that all have to be in the
    picture; label: of the values to colour by, None if it is plain; top: the highest of them; cut: where a 3D body is
    cut open."""

    mesh: Mesh
    nodes: IntArray
    triangles: IntArray
    outline: IntArray
    solids: Mapping[str, tuple[Array, Array, IntArray]]
    seen: Array
    label: str | None = None
    top: float = 0.0
    cut: Cut | None = None
