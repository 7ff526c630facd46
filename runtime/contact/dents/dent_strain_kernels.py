"""Compiled kernels of `dent_strain.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled, summing
from softprint.runtime.mechanics.compliance.surface_compliance import CsrParts


def _dense_blocks(
    starts: IntArray,
    others: IntArray,
    corners: IntArray,
    gradients: Array,
    operator: NDArray[np.float32],
    share: CsrParts,
    near: CsrParts,
) -> NDArray[np.float32]:
    """From the whole of G^T."""
    n_anchors, dim, n_nodes, _ = operator.shape
    n = len(starts) - 1
    P = csr_matrix(share[::-1], shape=(n, n_anchors)).toarray()
    N = csr_matrix(near[::-1], shape=(n * dim, n_nodes * dim)).toarray()
    G = np.einsum("jk,keXa->jeXa", P, operator) + N.reshape(n, dim, n_nodes, dim)
    of = np.repeat(np.arange(n), np.diff(starts))
    moved = G[others[:, None, None], :, corners[of]]
    return np.einsum("pcvea,pcvb->pcabe", moved, gradients[of]).astype(np.float32)


@compiled(reference=_dense_blocks)
def strain_blocks(
    starts: IntArray,
    others: IntArray,
    corners: IntArray,
    gradients: Array,
    operator: NDArray[np.float32],
    share: CsrParts,
    near: CsrParts,
) -> NDArray[np.float32]:
    """D (p, c, dim, dim, dim) of pairs of contact nodes. corners (n, c, v) and gradients (n, c, v, dim) of the cells at
    each; operator, share and near as in `SurfaceCompliance`, the last two as row starts, columns and entries."""
    n, cells, v, dim = gradients.shape
    blocks = np.zeros((len(others), cells, dim, dim, dim), dtype=np.float32)
    G = np.empty((dim, dim))
    for i in range(n):
        for pair in range(starts[i], starts[i + 1]):
            j = others[pair]
            first = near[0][j * dim]
            count = near[0][j * dim + 1] - first
            columns = near[1][first : first + count]
            for c in range(cells):
                for k in range(v):
                    X = corners[i, c, k]
                    G[:] = 0.0
                    for entry in range(share[0][j], share[0][j + 1]):
                        part, column = share[2][entry], operator[share[1][entry]]
                        for e in range(dim):
                            for a in range(dim):
                                G[a, e] += part * column[e, X, a]
                    # The rows of one contact node have their entries in the same columns, ascending.
                    at = np.searchsorted(columns, X * dim)
                    if at < count and columns[at] == X * dim:
                        for e in range(dim):
                            for a in range(dim):
                                G[a, e] += near[2][first + e * count + at + a]
                    for a in range(dim):
                        for b in range(dim):
                            for e in range(dim):
                                blocks[pair, c, a, b, e] += G[a, e] * gradients[i, c, k, b]
    return blocks


def _looked_up(
    of: IntArray, nodes: IntArray, starts: IntArray, others: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    owner = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    pairs = np.flatnonzero(np.isin(owner, of) & np.isin(others, nodes))
    first = np.searchsorted(owner[pairs], of)
    return np.append(first, len(pairs)), np.searchsorted(nodes, others[pairs]), pairs


@compiled(reference=_looked_up)
def near_among(
    of: IntArray, nodes: IntArray, starts: IntArray, others: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    """Which of some contact nodes (m,) are near each of others (n,), both ascending: where those of each begin (n +
    1,), their places (q,), and among all pairs (q,). starts, others: of all contact nodes, see `NearNodes`."""
    n, m = len(of), len(nodes)
    most = 0
    for i in of:
        most += min(m, starts[i + 1] - starts[i])
    first, among, pairs = np.zeros(n + 1, np.int64), np.empty(most, np.int64), np.empty(most, np.int64)
    count = 0
    for r in range(n):
        pair, last = starts[of[r]], starts[of[r] + 1]
        for s in range(m):
            while pair < last and others[pair] < nodes[s]:
                pair += 1
            if pair == last:
                break
            if others[pair] == nodes[s]:
                among[count], pairs[count] = s, pair
                count += 1
        first[r + 1] = count
    return first, among[:count], pairs[:count]


def _dense(
    n_forces: int, sizes: IntArray, starts: IntArray, others: IntArray, pairs: IntArray, blocks: NDArray[np.float32]
) -> Array:
    n, (_, size, dim) = len(starts) - 1, blocks.shape
    D = np.zeros((n, n_forces, size, dim))
    D[np.repeat(np.arange(n), np.diff(starts)), others] = blocks[pairs]
    D *= (np.arange(size) < sizes[:, None])[:, None, :, None]
    return D


@compiled(
    reference=lambda sizes, starts, others, pairs, blocks, forces: np.einsum(
        "ijse,jec->isc", _dense(len(forces), sizes, starts, others, pairs, blocks), forces
    )
)
def strains_by(
    sizes: IntArray,
    starts: IntArray,
    others: IntArray,
    pairs: IntArray,
    blocks: NDArray[np.float32],
    forces: Array,
) -> Array:
    """sum_j D_ij phi_j (n, s, c) by forces (m, dim, c), with the blocks (p, s, dim) of D that are not zero, and zero
    beyond the size of each; the others as in `StrainBetween`."""
    n, dim, c = len(starts) - 1, forces.shape[1], forces.shape[2]
    size, most = blocks.shape[1], np.diff(starts).max() * dim
    strains = np.zeros((n, size, c))
    D, phi = np.empty((most, size)), np.empty((most, c))
    for i in range(n):
        # One product of dense matrices for each node.
        row, own = 0, sizes[i]
        for k in range(starts[i], starts[i + 1]):
            block, j = blocks[pairs[k]], others[k]
            for e in range(dim):
                for s in range(own):
                    D[row, s] = block[s, e]
                phi[row] = forces[j, e]
                row += 1
        strains[i, :own] = np.ascontiguousarray(D[:row, :own].T) @ phi[:row]
    return strains


@summing(
    reference=lambda n_forces, sizes, starts, others, pairs, blocks, by_strain: np.einsum(
        "ijse,isc->jec", _dense(n_forces, sizes, starts, others, pairs, blocks), by_strain
    )
)
def forces_by(
    n_forces: int,
    sizes: IntArray,
    starts: IntArray,
    others: IntArray,
    pairs: IntArray,
    blocks: NDArray[np.float32],
    by_strain: Array,
) -> Array:
    """sum_i D_ij^T y_i (m, dim, c) of y (n, s, c) on m nodes; the others as in `strains_by`."""
    n, dim, columns = len(starts) - 1, blocks.shape[2], by_strain.shape[2]
    found = np.zeros((n_forces, dim, columns))
    D = np.empty((np.diff(starts).max() * dim, blocks.shape[1]))
    for i in range(n):
        # One product of dense matrices for each node.
        row, own = 0, sizes[i]
        for k in range(starts[i], starts[i + 1]):
            block = blocks[pairs[k]]
            for e in range(dim):
                for s in range(own):
                    D[row, s] = block[s, e]
                row += 1
        pulled = np.ascontiguousarray(D[:row, :own]) @ by_strain[i, :own]
        row = 0
        for k in range(starts[i], starts[i + 1]):
            for e in range(dim):
                for c in range(columns):
                    found[others[k], e, c] += pulled[row, c]
                row += 1
    return found
