"""Python interface to `native/blocks.c` for one dimension and one precision, called with numpy arrays.

Node vectors are (n, width) here, with width 4 in 3D; the orthonormal basis Q of the constraints is (tiles, n, tile),
where `tile` columns are read together: see the C source. Every sum over all nodes that a solve needs is returned by one
of `product`, `coordinates`, `descend` and `deflate`.
"""

from __future__ import annotations

import ctypes
from typing import ClassVar

import numpy as np

from softprint.fem_truth.linalg.small_blocks import absolute_inverses
from softprint.fem_truth.native.library import load_library
from softprint.runtime.arrays import Array, IntArray

Real = type[np.float32] | type[np.float64]


class BlockKernels:
    """real: np.float32 or np.float64. All arrays are C-contiguous and of this type unless said otherwise."""

    _made: ClassVar[dict[tuple[int, Real, int], BlockKernels]] = {}

    def __init__(self, dim: int, real: Real, tile: int = 8) -> None:
        self.dim, self.real, self.tile, self.width = dim, real, tile, 4 if dim == 3 else 2
        library = load_library(
            "blocks.c", DIM=dim, REAL="float" if real is np.float32 else "double", TILE=tile
        )
        size, array, number = ctypes.c_int64, ctypes.c_void_p, ctypes.c_double

        def function(name: str, returns: type | None, *arguments: type) -> ctypes._NamedFuncPointer:
            found = getattr(library, name)
            found.restype, found.argtypes = returns, arguments
            return found

        self._product = function("product", number, size, *[array] * 6)
        self._coordinates = function("coordinates", None, size, size, *[array] * 3)
        self._descend = function("descend", number, size, size, *[array] * 4, number, *[array] * 3)
        self._deflate = function("deflate", number, size, size, *[array] * 4)
        self._advance = function("advance", None, size, number, number, *[array] * 3)
        self._invert = function("invert", size, size, *[array] * 3)

    @classmethod
    def of(cls, dim: int, real: Real, tile: int = 8) -> BlockKernels:
        """The kernels for these arguments, cached."""
        if (dim, real, tile) not in cls._made:
            cls._made[dim, real, tile] = cls(dim, real, tile)
        return cls._made[dim, real, tile]

    def vector(self, v: Array) -> Array:
        """A node vector (n, dim) in the layout of the kernels."""
        padded: Array = np.zeros((len(v), self.width), dtype=self.real)
        padded[:, : self.dim] = v
        return padded

    def tiled(self, basis: Array) -> Array:
        """Q (n, rank) in tiles (tiles, n, tile), padded with zeros."""
        n, rank = basis.shape
        tiles = -(-rank // self.tile)
        filled: Array = np.zeros((n, tiles * self.tile), dtype=self.real)
        filled[:, :rank] = basis
        return np.ascontiguousarray(filled.reshape(n, tiles, self.tile).transpose(1, 0, 2))

    def product(
        self, row_starts: IntArray, columns: IntArray, diagonal: Array, upper: Array, x: Array, y: Array
    ) -> float:
        """y = A x; returns x . y. row_starts (n + 1,), columns (n_blocks,): pattern of the blocks above the diagonal,
        int32; diagonal (n, dim, dim); upper (n_blocks + 1, dim, dim)."""
        arrays = _at(row_starts), _at(columns), _at(diagonal), _at(upper), _at(x), _at(y)
        return float(self._product(len(x), *arrays))

    def coordinates(self, Q: Array, v: Array) -> Array:
        """Q^T v, (tiles * tile, width), summed in double precision."""
        c = np.empty((len(Q) * self.tile, self.width))
        self._coordinates(len(v), len(Q), _at(Q), _at(v), _at(c))
        return c.astype(self.real, copy=False)

    def descend(
        self, Q: Array, c: Array, free: Array, inverse: Array, alpha: float, y: Array, r: Array, z: Array
    ) -> float:
        """r -= alpha (y - Q c) and z = D^-1 r, for entries where free (n, width) is 1; returns |r|^2."""
        arrays = _at(y), _at(r), _at(z)
        return float(self._descend(len(r), len(Q), _at(Q), _at(c), _at(free), _at(inverse), alpha, *arrays))

    def deflate(self, Q: Array, c: Array, r: Array, z: Array) -> float:
        """z -= Q c; returns r . z."""
        return float(self._deflate(len(z), len(Q), _at(Q), _at(c), _at(r), _at(z)))

    def advance(self, alpha: float, beta: float, z: Array, x: Array, p: Array) -> None:
        """x += alpha p, then p = z + beta p."""
        self._advance(len(x), alpha, beta, _at(z), _at(x), _at(p))

    def inverses(self, blocks: Array) -> Array:
        """Inverses (n, dim, dim) of float64 symmetric blocks; indefinite blocks are made positive definite first."""
        inverse: Array = np.empty(blocks.shape, dtype=self.real)
        left = np.empty(len(blocks), dtype=np.int64)
        count = self._invert(len(blocks), _at(blocks), _at(inverse), _at(left))
        if count:
            inverse[left[:count]] = absolute_inverses(blocks[left[:count]])
        return inverse


def fitting_tile(rank: int) -> int:
    """The tile width, from 5 to 8 columns, that needs the least zero padding for `rank` columns."""
    return min((8, 7, 6, 5), key=lambda tile: -rank % tile)


def _at(array: Array | IntArray) -> int:
    """Address of the array's data; the caller keeps the array alive."""
    return int(array.ctypes.data)
