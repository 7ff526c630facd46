"""B = dF/drows of cells in groups, each of which depends on some of the handle rows only (`handle_sparsity.py`).

The cell is the last index in memory, for vectorisation over cells: the block of group g is B_g (k_g, dim, dim, dim,
m_g) over (row, axis, i, j, cell). The blocks of all groups follow each other in one array.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.handle_sparsity import CellGroup
from softprint.runtime.compiled import compiled, summing

Singles = NDArray[np.float32]
Floats = NDArray[np.floating[Any]]


class CellGroupBlocks:
    """The layout of the blocks. The arrays (n,) with their values, `blocks`, are passed in."""

    def __init__(self, groups: Sequence[CellGroup], n_rows: int, dim: int) -> None:
        """Every cell belongs to one group; a group depends on some of n_rows rows."""
        self._dim, self._size = dim, n_rows * dim
        self._groups = [(cells, (rows[:, None] * dim + np.arange(dim)).ravel()) for cells, rows in groups]
        cells, first = _joined([cells for cells, _ in self._groups])
        self._layout = cells, first, *_joined([columns for _, columns in self._groups])
        entries = [len(columns) * dim**2 * len(cells) for cells, columns in self._groups]
        self._offset = np.concatenate([[0], np.cumsum(entries)])

    @property
    def products(self) -> int:
        """The number of multiplications of B^T A B."""
        return sum(len(cells) * self._dim**2 * len(columns) ** 2 for cells, columns in self._groups)

    def packed(self, B: Array) -> Array:
        """The blocks of B (m, dim*dim, n_rows*dim)."""
        return np.concatenate([B[cells][:, :, columns].T.ravel() for cells, columns in self._groups])

    def dense(self, blocks: Floats) -> Floats:
        """B (m*dim*dim, n_rows*dim) from its blocks, in their precision."""
        B = np.zeros((len(self._layout[0]), self._dim**2, self._size), dtype=blocks.dtype)
        for (cells, columns), block in zip(self._groups, self._each(blocks), strict=True):
            B[cells[:, None], :, columns] = block.transpose(2, 0, 1)
        return B.reshape(-1, self._size)

    def to_world(self, blocks: Singles, rotations: Array) -> Singles:
        """Blocks of R_c B_c R_c^T, in the world frame, of blocks in the rotated frame of every cell; rotations: R (m,
        dim, dim). All in single precision."""
        cells, first, _, first_column = self._layout
        groups = first, np.diff(first_column) // self._dim
        return _to_world(*groups, blocks, rotations[cells].astype(np.float32))

    def seen(self, blocks: Floats, rotations: Array, rows: Array) -> Array:
        """B_c R_c^T rows (m, dim, dim) of rows (n_rows, dim), in the rotated frame of every cell; rotations: R (m, dim,
        dim)."""
        return _seen(*self._layout, blocks, rotations, rows)

    def times(self, blocks: Floats, change: Array) -> Array:
        """B change (m, dim, dim) of a change (n_rows*dim,) of the rows."""
        return _times(*self._layout, blocks, change, self._dim)

    def gathered(self, blocks: Floats, stress: Array) -> Array:
        """B^T stress (n_rows*dim,) of a stress (m, dim, dim)."""
        return _gathered(*self._layout, blocks, stress, self._size)

    def stiffness(self, blocks: Floats, tangent: Array, along: Array | None = None) -> Array:
        """B^T A B (n, n) of tangents A (m, dim, dim, dim, dim); along: see `RowHessian`. In single precision, at half
        the cost: it only gives Newton's method a direction."""
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
    """The parts concatenated, and the start of each."""
    first = np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
    return np.concatenate(parts), first


def _groups(
    layout: Sequence[IntArray], blocks: Floats, dim: int
) -> Iterator[tuple[IntArray, IntArray, Floats]]:
    """Cells (m,), columns (k,) and B (k, dim, dim, m) over (column, i, j, cell), group by group."""
    cells, first, columns, first_column = layout
    at = 0
    for g in range(len(first) - 1):
        own, used = cells[first[g] : first[g + 1]], columns[first_column[g] : first_column[g + 1]]
        shape = len(used), dim, dim, len(own)
        yield own, used, blocks[at : at + np.prod(shape)].reshape(shape)
        at += int(np.prod(shape))


def _dense_times(*arguments: Any) -> Array:
    *layout, blocks, change, dim = arguments
    result = np.empty((len(layout[0]), dim, dim))
    for own, used, B in _groups(layout, blocks, dim):
        result[own] = np.einsum("kijm,k->mij", B, change[used])
    return result


@summing(reference=_dense_times)
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


def _dense_gathered(*arguments: Any) -> Array:
    *layout, blocks, stress, n_columns = arguments
    result = np.zeros(n_columns)
    for own, used, B in _groups(layout, blocks, stress.shape[1]):
        result[used] += np.einsum("kijm,mij->k", B, stress[own])
    return result


@summing(reference=_dense_gathered)
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


def _dense_seen(*arguments: Any) -> Array:
    *layout, blocks, rotations, rows = arguments
    result = np.empty(rotations.shape)
    for own, used, B in _groups(layout, blocks, rows.shape[1]):
        rotated = (rows @ rotations[own]).reshape(len(own), -1)[:, used]  # R^T rows, by (row, axis)
        result[own] = np.einsum("kijm,mk->mij", B, rotated)
    return result


@summing(reference=_dense_seen)
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
        # Repeated for all j of all cells, in the layout of B.
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


def _dense_to_world(first: IntArray, n_rows: IntArray, blocks: Singles, rotations: Singles) -> Singles:
    parts, at, dim = [], 0, rotations.shape[1]
    for start, end, rows in zip(first[:-1], first[1:], n_rows):
        shape, R = (rows, dim, dim, dim, end - start), rotations[start:end]
        B = blocks[at : at + np.prod(shape)].reshape(shape)
        parts.append(np.einsum("mia,mbc,rcajm->rbijm", R, R, B).ravel())
        at += int(np.prod(shape))
    return np.concatenate(parts)


@summing(reference=_dense_to_world)
def _to_world(first: IntArray, n_rows: IntArray, blocks: Singles, rotations: Singles) -> Singles:
    """R B R^T of every group; n_rows: number of rows of each; rotations: of the cells, group by group."""
    dim, at = rotations.shape[1], 0
    rotated = np.empty(blocks.shape, np.float32)
    for group in range(len(first) - 1):
        own = rotations[first[group] : first[group + 1]]
        # The rotations are repeated for all j of all cells. In 2D the third of every three products is zero.
        size, last = dim * len(own), dim - 1
        R = np.zeros((dim, 3, dim, len(own)), np.float32)
        for c in range(len(own)):
            for i in range(dim):
                for a in range(dim):
                    R[i, a, :, c] = own[c, i, a]
        by_axis = R.reshape(dim, 3, size)
        end = at + n_rows[group] * dim * dim * size
        B = blocks[at:end].reshape(n_rows[group], dim, dim, size)
        result = rotated[at:end].reshape(n_rows[group], dim, dim, size)
        at = end
        left = np.empty((dim, dim, size), np.float32)
        for r in range(n_rows[group]):
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
    return rotated


def _dense_along(B: Floats, columns: IntArray, along: Array) -> tuple[IntArray, Array]:
    to = np.flatnonzero(along[columns].any(axis=0))
    return to, np.einsum("kn,ksm->nsm", along[np.ix_(columns, to)], B)


@summing(reference=_dense_along)
def _along(B: Floats, columns: IntArray, along: Array) -> tuple[IntArray, Singles]:
    """The directions (n,) for which B T is not zero, and B T (n, s, m) of B (k, s, m). T (k, n) are the rows `columns`
    of all directions `along` (n_rows*dim, N), which are mostly zero."""
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


@summing(reference=lambda A, B: np.einsum("ijm,njm->nim", A, B))
def _weighted(A: Singles, B: Singles) -> Singles:
    """A_c B_c (n, s, m) of A (s, s, m) and B (n, s, m)."""
    result = np.zeros(B.shape, np.float32)
    s, m = len(A), B.shape[2]
    for n in range(len(B)):
        for i in range(s):
            into = result[n, i]
            # Three at a time, to read memory less often.
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


def _added(total: Array, to: IntArray, block: Singles) -> Array:
    select = np.eye(len(total))[to]
    return total + select.T @ block @ select


@compiled(reference=_added)
def _add(total: Array, to: IntArray, block: Singles) -> None:
    for i in range(len(to)):
        row = total[to[i]]
        for j in range(len(to)):
            row[to[j]] += block[i, j]
