"""The internal response of some nodes (m,), read where it lies: modes L (n, dim, n_rows, dim), weight w (n, dim, dim),
turns R (n, dim, dim)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.compiled import summing

Floats = NDArray[np.floating[Any]]


@summing
def _alike(first: Array, second: Array) -> bool:
    for a in range(len(first)):
        for b in range(len(first)):
            if first[a, b] != second[a, b]:
                return False
    return True


@summing
def displacement(
    modes: Floats, weight: Floats, index: IntArray, rows: Array, rest: Array, gravity: Array, turns: Array
) -> Array:
    """R (L d + w R^T g) (m, dim) for the strain d = R^T rows - rest, rows and rest (n_rows, dim).

    Modes may be float32, the strain is not: rounded, it would move loads by nanometres to and fro as the rows change by
    less, and the contact energy of a line search with them.
    """
    n_rows, dim = rows.shape
    by_node = modes.reshape(len(modes), dim, n_rows * dim)
    by_axis, at_rest = np.ascontiguousarray(rows.T), np.ascontiguousarray(rest.T)
    along, strain, hanging = np.empty(n_rows), np.empty(n_rows * dim), np.empty(dim)
    u = np.zeros((len(index), dim))
    for k, node in enumerate(index):
        turn = turns[node]
        # Where a body turns as one, all its nodes see one strain.
        if k == 0 or not _alike(turn, turns[index[k - 1]]):
            for b in range(dim):
                for r in range(n_rows):
                    along[r] = by_axis[0, r] * turn[0, b] + by_axis[1, r] * turn[1, b] - at_rest[b, r]
                for c in range(2, dim):
                    for r in range(n_rows):
                        along[r] += by_axis[c, r] * turn[c, b]
                for r in range(n_rows):
                    strain[r * dim + b] = along[r]
                hanging[b] = 0.0
                for a in range(dim):
                    hanging[b] += gravity[a] * turn[a, b]
        for b in range(dim):
            row = by_node[node, b]
            total = row[0] * strain[0]
            for column in range(1, n_rows * dim):
                total += row[column] * strain[column]
            moved = float(total)
            for c in range(dim):
                moved += weight[node, b, c] * hanging[c]
            for a in range(dim):
                u[k, a] += turn[a, b] * moved
    return u


@summing
def derivative(modes: Floats, index: IntArray, mean: Array, positions: Array, turns: Array) -> Array:
    """R (L - (L mean) (x) positions) R^T (m, dim, n_rows, dim) [a, r, b]: du_a/drows_rb with the turns R held. mean
    (n_rows,): weights of the rows' mean translation, which strains nothing; positions (n_rows,): what it moves."""
    dim, n_rows = turns.shape[1], len(mean)
    result = np.empty((len(index), dim, n_rows, dim))
    strained = np.empty((dim, n_rows, dim))
    for k in range(len(index)):
        strained[:] = modes[index[k]]
        for a in range(dim):
            for b in range(dim):
                drift = 0.0
                for r in range(n_rows):
                    drift += strained[a, r, b] * mean[r]
                for r in range(n_rows):
                    strained[a, r, b] -= drift * positions[r]
        _to_world(strained, turns[index[k]], result[k])
    return result


@summing
def felt(modes: Floats, index: IntArray, mean: Array, positions: Array, turns: Array, forces: Array) -> Array:
    """sum_k f_k . du_k/drows (n_rows, dim), `derivative` times forces f (m, dim), without finding it: with t = R^T f,
    (t L - (t L mean) (x) positions) R^T."""
    dim, n_rows = turns.shape[1], len(mean)
    by_node = modes.reshape(len(modes), dim, n_rows * dim)
    total, strained = np.zeros((n_rows, dim)), np.empty(n_rows * dim)
    for k, node in enumerate(index):
        turn = turns[node]
        strained[:] = 0.0
        for i in range(dim):
            share, row = 0.0, by_node[node, i]
            for a in range(dim):
                share += forces[k, a] * turn[a, i]
            for column in range(n_rows * dim):
                strained[column] += share * row[column]
        by_row = strained.reshape(n_rows, dim)
        for c in range(dim):
            drift = 0.0
            for r in range(n_rows):
                drift += by_row[r, c] * mean[r]
            for r in range(n_rows):
                by_row[r, c] -= drift * positions[r]
        for r in range(n_rows):
            for c in range(dim):
                for b in range(dim):
                    total[r, b] += by_row[r, c] * turn[b, c]
    return total


@summing
def to_world(blocks: Array, turns: Array) -> Array:
    """R B_r R^T (n, dim, k, dim) of blocks B_r [i, r, j] (n, dim, k, dim), turned by R (n, dim, dim)."""
    result = np.empty(blocks.shape)
    for k in range(len(blocks)):
        _to_world(blocks[k], turns[k], result[k])
    return result


@summing
def _to_world(blocks: Array, turn: Array, result: Array) -> None:
    dim, n_blocks = turn.shape[0], blocks.shape[1]
    # In 2D the third of every three products is with zero.
    last = dim - 1
    left = np.empty(n_blocks * dim)
    across = np.zeros((dim, 3))
    across[:, :dim] = turn
    first, second, third = blocks[0].ravel(), blocks[1].ravel(), blocks[last].ravel()
    for a in range(dim):
        for m in range(n_blocks * dim):
            left[m] = across[a, 0] * first[m] + across[a, 1] * second[m] + across[a, 2] * third[m]
        turned = result[a].ravel()
        for r in range(n_blocks):
            x, y, z = left[dim * r], left[dim * r + 1], left[dim * r + last]
            for b in range(dim):
                turned[dim * r + b] = x * across[b, 0] + y * across[b, 1] + z * across[b, 2]
