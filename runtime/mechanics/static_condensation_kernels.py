"""The internal response of some nodes (m,), read where it lies: modes L of the handle rows that each node feels, weight
w (n, dim, dim), turns R (n, dim, dim)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.compiled import summing

Floats = NDArray[np.floating[Any]]


class FeltModes(NamedTuple):
    """L of n nodes, without the rows that a node does not feel. Nodes feel sets of rows: node X the set of[X], set s
    the rows felt[start[s]:start[s + 1]], k of them. `values` are flat, node by node: those of X begin at first[X], and
    are L_X (dim, dim, k) over (axis, axis of the row, row)."""

    values: Floats
    first: IntArray
    of: IntArray
    start: IntArray
    felt: IntArray


@summing
def _alike(first: Array, second: Array) -> bool:
    for a in range(len(first)):
        for b in range(len(first)):
            if first[a, b] != second[a, b]:
                return False
    return True


@summing
def displacement(
    modes: FeltModes,
    weight: Floats,
    index: IntArray,
    rows: Array,
    rest: Array,
    gravity: Array,
    turns: Array,
) -> Array:
    """R (L d + w R^T g) (m, dim) for the strain d = R^T rows - rest, rows and rest (n_rows, dim).

    Modes may be float32, the strain is not: rounded, it would move loads by nanometres to and fro as the rows change by
    less, and the contact energy of a line search with them.
    """
    n_rows, dim = rows.shape
    values, first, of, start, felt = modes
    # The rows of the sets that are met, one set after the other.
    by_axis, at_rest = np.empty((dim, len(felt))), np.empty((dim, len(felt)))
    met = np.zeros(len(start) - 1, dtype=np.bool_)
    strain, hanging = np.empty(n_rows * dim), np.empty(dim)
    u = np.zeros((len(index), dim))
    for n, node in enumerate(index):
        turn, begin, end = turns[node], start[of[node]], start[of[node] + 1]
        k = end - begin
        if not met[of[node]]:
            met[of[node]] = True
            for a in range(dim):
                for s in range(begin, end):
                    by_axis[a, s], at_rest[a, s] = rows[felt[s], a], rest[felt[s], a]
        # Where a body turns as one, all its nodes see one strain.
        before = index[n - 1]
        if n == 0 or of[node] != of[before] or not _alike(turn, turns[before]):
            for b in range(dim):
                along, x, y = strain[b * k : (b + 1) * k], by_axis[0, begin:end], by_axis[1, begin:end]
                for s in range(k):
                    along[s] = x[s] * turn[0, b] + y[s] * turn[1, b] - at_rest[b, begin + s]
                for c in range(2, dim):
                    z = by_axis[c, begin:end]
                    for s in range(k):
                        along[s] += z[s] * turn[c, b]
                hanging[b] = 0.0
                for a in range(dim):
                    hanging[b] += gravity[a] * turn[a, b]
        block = values[first[node] : first[node] + dim * dim * k].reshape(dim, dim * k)
        for b in range(dim):
            row, total = block[b], 0.0
            for column in range(dim * k):
                total += row[column] * strain[column]
            for c in range(dim):
                total += weight[node, b, c] * hanging[c]
            for a in range(dim):
                u[n, a] += turn[a, b] * total
    return u


@summing
def derivative(
    modes: FeltModes,
    index: IntArray,
    mean: Array,
    positions: Array,
    turns: Array,
) -> Array:
    """R (L - (L mean) (x) positions) R^T (m, dim, n_rows, dim) [a, r, b]: du_a/drows_rb with the turns R held. mean
    (n_rows,): weights of the rows' mean translation, which strains nothing; positions (n_rows,): what it moves."""
    dim, n_rows = turns.shape[1], len(mean)
    values, first, of, start, felt = modes
    result = np.empty((len(index), dim, n_rows, dim))
    strained = np.empty((dim, n_rows, dim))
    for n, node in enumerate(index):
        own = felt[start[of[node]] : start[of[node] + 1]]
        block = values[first[node] : first[node] + dim * dim * len(own)].reshape(dim, dim, len(own))
        strained[:] = 0.0
        for a in range(dim):
            for b in range(dim):
                drift = 0.0
                for s, r in enumerate(own):
                    strained[a, r, b] = block[a, b, s]
                    drift += block[a, b, s] * mean[r]
                for r in range(n_rows):
                    strained[a, r, b] -= drift * positions[r]
        _to_world(strained, turns[node], result[n])
    return result


@summing
def pulled_back(
    modes: FeltModes,
    index: IntArray,
    mean: Array,
    positions: Array,
    turns: Array,
    forces: Array,
) -> Array:
    """sum_k f_k . du_k/drows (n_rows, dim), `derivative` times forces f (m, dim), without finding it: with t = R^T f,
    (t L - (t L mean) (x) positions) R^T."""
    dim, n_rows = turns.shape[1], len(mean)
    values, first, of, start, felt = modes
    total, strained, drifts = np.zeros((n_rows, dim)), np.empty(n_rows * dim), np.zeros(dim)
    for n, node in enumerate(index):
        turn, own = turns[node], felt[start[of[node]] : start[of[node] + 1]]
        k = len(own)
        block = values[first[node] : first[node] + dim * dim * k].reshape(dim, dim * k)
        strained[:] = 0.0
        for i in range(dim):
            share, row = 0.0, block[i]
            for a in range(dim):
                share += forces[n, a] * turn[a, i]
            for column in range(dim * k):
                strained[column] += share * row[column]
        for c in range(dim):
            along, drift = strained[c * k : (c + 1) * k], 0.0
            for s in range(k):
                drift += along[s] * mean[own[s]]
                for b in range(dim):
                    total[own[s], b] += along[s] * turn[b, c]
            for b in range(dim):
                drifts[b] += drift * turn[b, c]
    for r in range(n_rows):
        for b in range(dim):
            total[r, b] -= positions[r] * drifts[b]
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
