"""B = dF/drows of cells in groups that each feel some of the handle rows only (`handle_sparsity.py`).

Cells come last in memory, so that what is done to one is done to several at once: of group g the block is B_g (k_g,
dim, dim, dim, m_g) over (row, axis, i, j, cell), and the blocks of all groups lie one after the other in one array.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.body.handle_sparsity import CellGroup
from runtime.compiled import compiled, summing

Singles = NDArray[np.float32]
Floats = NDArray[np.floating[Any]]


class CellGroupBlocks:
    """Where the blocks are. The arrays (n,) that hold them, `blocks`, are passed in."""

    def __init__(self, groups: Sequence[CellGroup], n_rows: int, dim: int) -> None:
        """Every cell is of one group; groups feel some of n_rows rows."""
        self._dim, self._size = dim, n_rows * dim
        self._groups = [(cells, (rows[:, None] * dim + np.arange(dim)).ravel()) for cells, rows in groups]
        cells, first = _joined([cells for cells, _ in self._groups])
        self._layout = cells, first, *_joined([columns for _, columns in self._groups])
        entries = [len(columns) * dim**2 * len(cells) for cells, columns in self._groups]
        self._offset = np.concatenate([[0], np.cumsum(entries)])

    @property
    def products(self) -> int:
        """Multiplications that B^T A B takes."""
        return sum(len(cells) * self._dim**2 * len(columns) ** 2 for cells, columns in self._groups)

    def packed(self, B: Array) -> Array:
        """The blocks of B (m, dim*dim, n_rows*dim)."""
        return np.concatenate([B[cells][:, :, columns].T.ravel() for cells, columns in self._groups])

    def dense(self, blocks: Floats) -> Array:
        """B (m*dim*dim, n_rows*dim) of its blocks."""
        B = np.zeros((len(self._layout[0]), self._dim**2, self._size))
        for (cells, columns), block in zip(self._groups, self._each(blocks), strict=True):
            B[cells[:, None], :, columns] = block.transpose(2, 0, 1)
        return B.reshape(-1, self._size)

    def to_world(self, blocks: Singles, rotations: Array) -> Singles:
        """R_c B_c R_c^T of what every cell sees, turned by R (m, dim, dim), all in single precision."""
        cells, first, _, first_column = self._layout
        groups = first, np.diff(first_column) // self._dim
        return _to_world(*groups, blocks, rotations[cells].astype(np.float32))

    def seen(self, blocks: Floats, rotations: Array, rows: Array) -> Array:
        """B_c R_c^T rows (m, dim, dim) of rows (n_rows, dim) as every cell sees them, turned by R (m, dim, dim)."""
        return _seen(*self._layout, blocks, rotations, rows)

    def times(self, blocks: Floats, change: Array) -> Array:
        """B change (m, dim, dim) of a change (n_rows*dim,)."""
        return _times(*self._layout, blocks, change, self._dim)

    def gathered(self, blocks: Floats, stress: Array) -> Array:
        """B^T stress (n_rows*dim,) of a stress (m, dim, dim)."""
        return _gathered(*self._layout, blocks, stress, self._size)

    def stiffness(self, blocks: Floats, tangent: Array, along: Array | None = None) -> Array:
        """B^T A B (n, n) of tangents A (m, dim, dim, dim, dim); along: see `RowHessian`. In single precision, at half
        the cost: Newton's method takes no more than a direction from it."""
        size = self._size if along is None else along.shape[1]
        total, s = np.zeros((size, size)), self._dim**2
        for (cells, columns), block in zip(self._groups, self._each(blocks), strict=True):
            if along is None:
                to, B = columns, block.astype(np.float32, copy=False)
            else:
                to, B = _along(block, columns, along)
            A = tangent[cells].reshape(-1, s, s).transpose(1, 2, 0).astype(np.float32)
            moved = _weighted(np.ascontiguousarray(A), B)
            _add(total, to, B.reshape(len(to), -1) @ moved.reshape(len(to), -1).T)
        return total

    def _each(self, blocks: Floats) -> list[Any]:
        """B_g (k_g*dim, dim*dim, m_g)."""
        parts = np.split(blocks, self._offset[1:-1])
        return [
            part.reshape(len(columns), -1, len(cells))
            for part, (cells, columns) in zip(parts, self._groups, strict=True)
        ]


def _joined(parts: Sequence[IntArray]) -> tuple[IntArray, IntArray]:
    """One after the other, and where each begins."""
    first = np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
    return np.concatenate(parts), first


@summing
def _times(
    cells: IntArray,
    first: IntArray,
    columns: IntArray,
    first_column: IntArray,
    blocks: Floats,
    change: Array,
    dim: int,
) -> Array:
    result = np.empty((len(cells), dim, dim))
    at, size = 0, dim * dim
    for group in range(len(first) - 1):
        own = cells[first[group] : first[group + 1]]
        m = len(own)
        total = np.zeros(size * m)
        for column in columns[first_column[group] : first_column[group + 1]]:
            block, share = blocks[at : at + size * m], change[column]
            for i in range(size * m):
                total[i] += share * block[i]
            at += size * m
        for c in range(m):
            into = result[own[c]].ravel()
            for i in range(size):
                into[i] = total[i * m + c]
    return result


@summing
def _gathered(
    cells: IntArray,
    first: IntArray,
    columns: IntArray,
    first_column: IntArray,
    blocks: Floats,
    stress: Array,
    n_columns: int,
) -> Array:
    result = np.zeros(n_columns)
    at, size = 0, stress.shape[1] * stress.shape[2]
    for group in range(len(first) - 1):
        own = cells[first[group] : first[group + 1]]
        m = len(own)
        local = np.empty(size * m)
        for c in range(m):
            by_entry = stress[own[c]].ravel()
            for i in range(size):
                local[i * m + c] = by_entry[i]
        for column in columns[first_column[group] : first_column[group + 1]]:
            block, total = blocks[at : at + size * m], 0.0
            for i in range(size * m):
                total += local[i] * block[i]
            result[column] += total
            at += size * m
    return result


@summing
def _seen(
    cells: IntArray,
    first: IntArray,
    columns: IntArray,
    first_column: IntArray,
    blocks: Floats,
    rotations: Array,
    rows: Array,
) -> Array:
    dim, at = rows.shape[1], 0
    result = np.empty((len(cells), dim, dim))
    for group in range(len(first) - 1):
        own = cells[first[group] : first[group + 1]]
        m = len(own)
        # For all j of all cells, as B is.
        R, size = np.empty((dim, dim, dim, m)), dim * m
        for c in range(m):
            for a in range(dim):
                for b in range(dim):
                    R[a, b, :, c] = rotations[own[c], a, b]
        by_axis, total, share = R.reshape(dim, dim, size), np.zeros((dim, size)), np.empty(size)
        for column in columns[first_column[group] : first_column[group + 1]]:
            row, b = rows[column // dim], column % dim
            x, y, z = by_axis[0, b], by_axis[1, b], by_axis[dim - 1, b]
            third = row[2] if dim == 3 else 0.0
            for k in range(size):
                share[k] = row[0] * x[k] + row[1] * y[k] + third * z[k]
            for i in range(dim):
                into, entry = total[i], blocks[at : at + size]
                for k in range(size):
                    into[k] += share[k] * entry[k]
                at += size
        for c in range(m):
            for i in range(dim):
                for j in range(dim):
                    result[own[c], i, j] = total[i, j * m + c]
    return result


@summing
def _to_world(first: IntArray, felt: IntArray, blocks: Singles, rotations: Singles) -> Singles:
    """R B R^T of every group; felt: rows of each; rotations: of the cells, group by group."""
    dim, at = rotations.shape[1], 0
    turned = np.empty(blocks.shape, np.float32)
    for group in range(len(first) - 1):
        own = rotations[first[group] : first[group + 1]]
        # What is turned alike is turned at once, all j of all cells. In 2D the third of every three products is with 0.
        size, last = dim * len(own), dim - 1
        R = np.zeros((dim, 3, dim, len(own)), np.float32)
        for c in range(len(own)):
            for i in range(dim):
                for a in range(dim):
                    R[i, a, :, c] = own[c, i, a]
        by_axis = R.reshape(dim, 3, size)
        end = at + felt[group] * dim * dim * size
        B = blocks[at:end].reshape(felt[group], dim, dim, size)
        result = turned[at:end].reshape(felt[group], dim, dim, size)
        at = end
        left = np.empty((dim, dim, size), np.float32)
        for r in range(felt[group]):
            for b in range(dim):
                x, y, z = B[r, b, 0], B[r, b, 1], B[r, b, last]
                for i in range(dim):
                    into, by_x, by_y, by_z = left[b, i], by_axis[i, 0], by_axis[i, 1], by_axis[i, 2]
                    for k in range(size):
                        into[k] = by_x[k] * x[k] + by_y[k] * y[k] + by_z[k] * z[k]
            for b in range(dim):
                by_x, by_y, by_z = by_axis[b, 0], by_axis[b, 1], by_axis[b, 2]
                for i in range(dim):
                    into, x, y, z = result[r, b, i], left[0, i], left[1, i], left[last, i]
                    for k in range(size):
                        into[k] = by_x[k] * x[k] + by_y[k] * y[k] + by_z[k] * z[k]
    return turned


@summing
def _along(B: Floats, columns: IntArray, along: Array) -> tuple[IntArray, Singles]:
    """Along which directions (n,) B T is not zero, and B T (n, s, m) of B (k, s, m): T (k, n) is of the rows `columns`
    of all directions, (n_rows*dim, N), which are zero for the most part."""
    to = np.empty(along.shape[1], np.int64)
    n = 0
    for direction in range(along.shape[1]):
        for column in columns:
            if along[column, direction] != 0.0:
                to[n] = direction
                n += 1
                break
    to = to[:n]
    result = np.zeros((n, B.shape[1] * B.shape[2]), np.float32)
    for k, column in enumerate(columns):
        block = B[k].ravel()
        for at in range(n):
            share = np.float32(along[column, to[at]])
            if share != 0.0:
                into = result[at]
                for i in range(len(block)):
                    into[i] += share * np.float32(block[i])
    return to, result.reshape(n, B.shape[1], B.shape[2])


@summing
def _weighted(A: Singles, B: Singles) -> Singles:
    """A_c B_c (n, s, m) of A (s, s, m) and B (n, s, m)."""
    result = np.zeros(B.shape, np.float32)
    s, m = len(A), B.shape[2]
    for n in range(len(B)):
        for i in range(s):
            into = result[n, i]
            # Three at a time, for memory to be read less often.
            for j in range(0, s - 2, 3):
                x, y, z = B[n, j], B[n, j + 1], B[n, j + 2]
                by_x, by_y, by_z = A[i, j], A[i, j + 1], A[i, j + 2]
                for c in range(m):
                    into[c] += by_x[c] * x[c] + by_y[c] * y[c] + by_z[c] * z[c]
            for j in range(s - s % 3, s):
                last, by_last = B[n, j], A[i, j]
                for c in range(m):
                    into[c] += by_last[c] * last[c]
    return result


@compiled
def _add(total: Array, to: IntArray, block: Singles) -> None:
    for i in range(len(to)):
        row = total[to[i]]
        for j in range(len(to)):
            row[to[j]] += block[i, j]
