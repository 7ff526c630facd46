"""Compiled kernels of static condensation at some nodes (m,) of n, without copying its arrays: sparse modes L, weight w
(n, dim, dim), rotations R (n, dim, dim)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import summing

Floats = NDArray[np.floating[Any]]


class SparseModes(NamedTuple):
    """L of n nodes, without the rows for which it is zero. The nonzero rows of node X are those of set of[X]; set s has
    the k rows rows[start[s]:start[s + 1]]. `values` are flat, node by node: those of X begin at first[X], and are L_X
    (dim, dim, k) over (axis, axis of the row, row)."""

    values: Floats
    first: IntArray
    of: IntArray
    start: IntArray
    rows: IntArray


def _dense(modes: SparseModes, index: IntArray, n_rows: int, dim: int) -> Array:
    """L (m, dim, n_rows, dim) [axis, row, axis of the row] of some nodes (m,)."""
    L = np.zeros((len(index), dim, n_rows, dim))
    for n, node in enumerate(index):
        own = modes.rows[modes.start[modes.of[node]] : modes.start[modes.of[node] + 1]]
        block = modes.values[modes.first[node] :][: dim * dim * len(own)].reshape(dim, dim, len(own))
        L[n][:, own] = block.transpose(0, 2, 1)
    return L


def _displacement(
    modes: SparseModes,
    weight: Array,
    index: IntArray,
    rows: Array,
    rest: Array,
    gravity: Array,
    rotations: Array,
) -> Array:
    L, R = _dense(modes, index, *rows.shape), rotations[index]
    u = np.einsum("narb,nrb->na", L, rows @ R - rest)
    u += np.einsum("nab,nb->na", weight[index], gravity @ R)
    return np.einsum("nab,nb->na", R, u)


def _derivative(
    modes: SparseModes, index: IntArray, mean: Array, affine_part: Array, rotations: Array
) -> Array:
    L, R = _dense(modes, index, len(mean), rotations.shape[1]), rotations[index]
    centred = L - np.einsum("nasb,s,r->narb", L, mean, affine_part)
    return np.einsum("nai,nirj,nbj->narb", R, centred, R)


@summing
def _equal(first: Array, second: Array) -> bool:
    for a in range(len(first)):
        for b in range(len(first)):
            if first[a, b] != second[a, b]:
                return False
    return True


@summing(reference=_displacement)
def displacement(
    modes: SparseModes,
    weight: Floats,
    index: IntArray,
    rows: Array,
    rest: Array,
    gravity: Array,
    rotations: Array,
) -> Array:
    """R (L d + w R^T g) (m, dim) for the strain d = R^T rows - rest, rows and rest (n_rows, dim).

    Modes may be float32, but the strain is float64: rounded to float32, it would shift contact nodes by nanometres for
    smaller changes of the rows, and add noise to the contact energy of a line search.
    """
    n_rows, dim = rows.shape
    values, first, of, start, nonzero = modes
    # The rows of each set, copied when the set is first used.
    by_axis, at_rest = np.empty((dim, len(nonzero))), np.empty((dim, len(nonzero)))
    copied = np.zeros(len(start) - 1, dtype=np.bool_)
    strain, rotated_gravity = np.empty(n_rows * dim), np.empty(dim)
    u = np.zeros((len(index), dim))
    for n, node in enumerate(index):
        R, begin, end = rotations[node], start[of[node]], start[of[node] + 1]
        k = end - begin
        if not copied[of[node]]:
            copied[of[node]] = True
            for a in range(dim):
                for s in range(begin, end):
                    by_axis[a, s], at_rest[a, s] = rows[nonzero[s], a], rest[nonzero[s], a]
        # Nodes with the same rotation and the same rows share one strain.
        before = index[n - 1]
        if n == 0 or of[node] != of[before] or not _equal(R, rotations[before]):
            for b in range(dim):
                along, x, y = strain[b * k : (b + 1) * k], by_axis[0, begin:end], by_axis[1, begin:end]
                for s in range(k):
                    along[s] = x[s] * R[0, b] + y[s] * R[1, b] - at_rest[b, begin + s]
                for c in range(2, dim):
                    z = by_axis[c, begin:end]
                    for s in range(k):
                        along[s] += z[s] * R[c, b]
                rotated_gravity[b] = 0.0
                for a in range(dim):
                    rotated_gravity[b] += gravity[a] * R[a, b]
        block = values[first[node] : first[node] + dim * dim * k].reshape(dim, dim * k)
        for b in range(dim):
            row, total = block[b], 0.0
            for column in range(dim * k):
                total += row[column] * strain[column]
            for c in range(dim):
                total += weight[node, b, c] * rotated_gravity[c]
            for a in range(dim):
                u[n, a] += R[a, b] * total
    return u


@summing(reference=_derivative)
def derivative(
    modes: SparseModes,
    index: IntArray,
    mean: Array,
    affine_part: Array,
    rotations: Array,
) -> Array:
    """R (L - (L mean) (x) affine_part) R^T (m, dim, n_rows, dim) [a, r, b]: du_a/drows_rb with the rotations R fixed.
    mean (n_rows,): weights of the mean translation of the rows; affine_part (n_rows,): change of the rows by a unit
    translation. Translations cause no strain."""
    dim, n_rows = rotations.shape[1], len(mean)
    values, first, of, start, nonzero = modes
    result = np.empty((len(index), dim, n_rows, dim))
    centred = np.empty((dim, n_rows, dim))
    for n, node in enumerate(index):
        own = nonzero[start[of[node]] : start[of[node] + 1]]
        block = values[first[node] : first[node] + dim * dim * len(own)].reshape(dim, dim, len(own))
        centred[:] = 0.0
        for a in range(dim):
            for b in range(dim):
                drift = 0.0
                for s, r in enumerate(own):
                    centred[a, r, b] = block[a, b, s]
                    drift += block[a, b, s] * mean[r]
                for r in range(n_rows):
                    centred[a, r, b] -= drift * affine_part[r]
        _to_world(centred, rotations[node], result[n])
    return result


@summing(reference=lambda *arguments: np.einsum("na,narb->rb", arguments[-1], _derivative(*arguments[:-1])))
def pulled_back(
    modes: SparseModes,
    index: IntArray,
    mean: Array,
    affine_part: Array,
    rotations: Array,
    forces: Array,
) -> Array:
    """sum_k f_k . du_k/drows (n_rows, dim), `derivative` times forces f (m, dim), without forming it: with t = R^T f,
    (t L - (t L mean) (x) affine_part) R^T."""
    dim, n_rows = rotations.shape[1], len(mean)
    values, first, of, start, nonzero = modes
    total, by_rows, drifts = np.zeros((n_rows, dim)), np.empty(n_rows * dim), np.zeros(dim)
    for n, node in enumerate(index):
        R, own = rotations[node], nonzero[start[of[node]] : start[of[node] + 1]]
        k = len(own)
        block = values[first[node] : first[node] + dim * dim * k].reshape(dim, dim * k)
        by_rows[:] = 0.0
        for i in range(dim):
            share, row = 0.0, block[i]
            for a in range(dim):
                share += forces[n, a] * R[a, i]
            for column in range(dim * k):
                by_rows[column] += share * row[column]
        for c in range(dim):
            along, drift = by_rows[c * k : (c + 1) * k], 0.0
            for s in range(k):
                drift += along[s] * mean[own[s]]
                for b in range(dim):
                    total[own[s], b] += along[s] * R[b, c]
            for b in range(dim):
                drifts[b] += drift * R[b, c]
    for r in range(n_rows):
        for b in range(dim):
            total[r, b] -= affine_part[r] * drifts[b]
    return total


@summing
def _to_world(blocks: Array, R: Array, result: Array) -> None:
    """R B R^T (dim, n_rows, dim) of blocks B, written into result."""
    dim, n_blocks = R.shape[0], blocks.shape[1]
    # In 2D the third of every three products is zero.
    last = dim - 1
    left = np.empty(n_blocks * dim)
    across = np.zeros((dim, 3))
    across[:, :dim] = R
    first, second, third = blocks[0].ravel(), blocks[1].ravel(), blocks[last].ravel()
    for a in range(dim):
        for m in range(n_blocks * dim):
            left[m] = across[a, 0] * first[m] + across[a, 1] * second[m] + across[a, 2] * third[m]
        rotated = result[a].ravel()
        for r in range(n_blocks):
            x, y, z = left[dim * r], left[dim * r + 1], left[dim * r + last]
            for b in range(dim):
                rotated[dim * r + b] = x * across[b, 0] + y * across[b, 1] + z * across[b, 2]
