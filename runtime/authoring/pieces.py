"""One piece of what is in several: the largest, if it is nearly all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.mesh.check import facet_pieces
from softprint.runtime.mesh.mesh import signed_volumes

# The largest piece is kept alone if it has nearly all of the volume, or most of it and nearly all of the extent along
# every axis: crumbs may go, limbs may not.
_NEARLY_ALL, _MOST, _EXTENT = 0.99, 0.9, 0.95


@dataclass(frozen=True, eq=False)
class Pieces:
    """count: number of pieces; share: of the largest in the volume; extent: its least share of the whole extent along
    an axis."""

    count: int
    share: float
    extent: float

    @property
    def one_is_enough(self) -> bool:
        """Whether the largest piece may stand for the whole."""
        return self.share >= _NEARLY_ALL or (self.share >= _MOST and self.extent >= _EXTENT)

    def __str__(self) -> str:
        return f"{self.count} pieces, the largest of which has {self.share:.1%} of the volume"


def pieces_of(points: Array, piece: IntArray, volume: Array) -> tuple[Pieces, int]:
    """Of samples of a solid at points (n, dim), each of the piece (n,) and of the volume (n,); with the number of the
    largest piece."""
    volumes = np.bincount(piece, weights=volume)
    largest = int(np.argmax(volumes))
    whole = np.maximum(np.ptp(points, axis=0), np.finfo(float).tiny)
    extent = float((np.ptp(points[piece == largest], axis=0) / whole).min())
    share = float(volumes[largest] / max(volumes.sum(), np.finfo(float).tiny))
    return Pieces(len(volumes), share, extent), largest


def largest_piece(points: Array, cells: IntArray) -> tuple[IntArray, Pieces]:
    """The cells of the largest of the pieces that share facets."""
    piece = facet_pieces(cells)
    volume = np.abs(signed_volumes(points, cells))
    found, largest = pieces_of(points[cells].mean(axis=1), piece, volume)
    return cells[piece == largest], found
