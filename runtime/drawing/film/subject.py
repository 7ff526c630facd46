"""What a film shows, apart from how it moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from softprint.runtime.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class Subject:
    """rest: (s, dim) vertices of the surface [m]; triangles: (t, 3), in 2D of the inside; outline: (o, 2) segments in 2D;
    solids: of the colliders by name, the middle of the place where each is (dim,), vertices (v, dim) in its own
    coordinates, and facets (f, dim); seen: (m, dim) points that all have to be in the picture; label: of the values to
    colour by, None if it is plain; top: the highest of them."""

    rest: Array
    triangles: IntArray
    outline: IntArray
    solids: Mapping[str, tuple[Array, Array, IntArray]]
    seen: Array
    label: str | None = None
    top: float = 0.0
