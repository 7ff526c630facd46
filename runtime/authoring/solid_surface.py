"""A triangle surface made ready to be filled: repaired, or as triangles that enclose a volume, or its pieces joined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import igl
import numpy as np
from scipy.ndimage import label

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.authoring.pieces import Pieces, pieces_of
from softprint.runtime.colliders.surface_mesh.examine import examine, merged_triangles
from softprint.runtime.colliders.surface_mesh.mesh_distance import MeshDistance
from softprint.runtime.colliders.surface_mesh.rebuild import closed_level, deviation
from softprint.runtime.errors import SoftprintError

# Cells of the grid of rebuilt and joined surfaces along the longest side: some three for the edge of a tetrahedron of
# a body that fills a tenth of its box, within these bounds.
_FOR_EDGE, _IN_BOX, _COARSEST, _FINEST = 3.5, 0.85, 32, 128
# A rebuilt surface from which more than this share of the file's triangles are farther than a cell has lost parts.
_LOST = 0.05
# Thickness of the layer that joins pieces, as a share of the diagonal; tried in turn.
LAYERS = (0.006, 0.012, 0.024)


@dataclass(frozen=True, eq=False)
class SolidSurface:
    """vertices (v, 3), triangles (t, 3); done: a sentence for each repair; volume: what it encloses, about."""

    vertices: Array
    triangles: IntArray
    done: list[str]
    volume: float


def solid_surface(vertices: Array, triangles: IntArray, source: str, cells: int) -> SolidSurface:
    """The surface of a solid, repaired as that of a collider, to be filled with so many cells.

    Where parts pass through each other or share edges, and nothing is open, the triangles stay as they are: winding
    numbers tell inside from outside when they are filled. Open surfaces are rebuilt by winding numbers, and pieces
    joined if none is nearly all of it. Raises SoftprintError for surfaces that enclose no well-defined volume.
    """
    examined = examine(vertices, triangles, source, _grid_cells(cells))
    found = _of(examined.vertices, examined.triangles, examined.done)
    if examined.rebuilt and (not examined.found["open edges"] or _lost(vertices, triangles, found, cells)):
        soup = merged_triangles(vertices, triangles, source)
        done = f"{examined.refusal.split(';')[0]}: left so, inside is told from outside by winding numbers"
        found = SolidSurface(*soup, [done], found.volume)
    if int(np.max(igl.facet_components(found.triangles)[1])) == 0:
        return found
    grid = _Grid.around(found.vertices, _grid_cells(cells))
    pieces = grid.pieces(grid.distance(found.vertices, found.triangles))
    return found if pieces.one_is_enough else joined(found, pieces, source, cells)


def _lost(vertices: Array, triangles: IntArray, rebuilt: SolidSurface, cells: int) -> bool:
    """Whether parts are missing in the rebuilt surface, as those thinner than a cell of its grid are."""
    apart = deviation(vertices, triangles, (rebuilt.vertices, rebuilt.triangles))
    spacing = float(np.ptp(vertices, axis=0).max()) / _grid_cells(cells)
    return bool(np.quantile(apart, 1.0 - _LOST) > spacing)


def joined(surface: SolidSurface, pieces: Pieces, source: str, cells: int) -> SolidSurface:
    """The surface with its pieces joined: a layer that closes the gaps is added, and half of it taken away again.
    Raises SoftprintError if no thin layer joins them."""
    grid = _Grid.around(surface.vertices, _grid_cells(cells))
    signed = grid.distance(surface.vertices, surface.triangles)
    diagonal = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    for share in LAYERS:
        layer = max(share * diagonal, grid.spacing)
        if not grid.pieces(signed - layer).one_is_enough:
            continue
        narrower = grid.distance(*grid.level(signed - layer)) + 0.5 * layer
        if not grid.pieces(narrower).one_is_enough:
            continue
        done = f"it is in {pieces}: joined by a layer of {0.5 * layer:.2g} m all over"
        return _of(*grid.level(narrower), [*surface.done, done])
    raise SoftprintError(
        f"{source}: is in {pieces}, and they are more than {2 * LAYERS[-1]:.0%} of its diagonal apart; a "
        "body is one piece: "
        "join them in a modeller, or export one of them"
    )


def _grid_cells(cells: int) -> int:
    return int(np.clip(_FOR_EDGE * (_IN_BOX * cells) ** (1.0 / 3.0), _COARSEST, _FINEST))


class _Grid(NamedTuple):
    origin: Array
    counts: IntArray
    spacing: float

    @classmethod
    def around(cls, vertices: Array, cells: int) -> _Grid:
        """With room for the thickest layer."""
        lower, upper = vertices.min(axis=0), vertices.max(axis=0)
        spacing = float((upper - lower).max()) / cells
        margin = spacing * np.ceil(4.0 + LAYERS[-1] * float(np.linalg.norm(upper - lower)) / spacing)
        counts = np.ceil((upper - lower + 2.0 * margin) / spacing).astype(np.int64) + 1
        return cls(lower - margin + 0.137 * spacing, counts, spacing)

    def distance(self, vertices: Array, triangles: IntArray) -> Array:
        """(n_x, n_y, n_z) the signed distance at its nodes."""
        return MeshDistance(vertices, triangles).on_grid(*self)

    def pieces(self, signed: Array) -> Pieces:
        """Of the inside of a field (n_x, n_y, n_z) at its nodes."""
        piece, _ = label(signed < 0.0)
        nodes = np.argwhere(piece > 0)
        if not len(nodes):
            return Pieces(0, 0.0, 0.0)
        numbers = piece[tuple(nodes.T)] - 1
        return pieces_of(nodes.astype(float), numbers, np.ones(len(nodes)))[0]

    def level(self, signed: Array) -> tuple[Array, IntArray]:
        """The zero level of a field (n_x, n_y, n_z) at its nodes."""
        axes = [start + self.spacing * np.arange(n) for start, n in zip(self.origin, self.counts)]
        z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
        points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
        return closed_level(np.ascontiguousarray(signed.transpose(2, 1, 0)), points, self.spacing)


def _of(vertices: Array, triangles: IntArray, done: list[str]) -> SolidSurface:
    return SolidSurface(vertices, triangles, done, _volume(vertices, triangles))


def _volume(vertices: Array, triangles: IntArray) -> float:
    return float(np.linalg.det(vertices[triangles] - vertices.mean(axis=0)).sum() / 6.0)
