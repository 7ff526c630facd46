"""Compiled kernels for points that are weighted means of nodes: corners (m, c) are the nodes of m points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled, summing

Floats = NDArray[np.floating[Any]]


def _unique(corners: IntArray, n_nodes: int) -> tuple[IntArray, IntArray]:
    nodes, own = np.unique(corners, return_inverse=True)
    return nodes, own.reshape(corners.shape)


@compiled(reference=_unique)
def numbered(corners: IntArray, n_nodes: int) -> tuple[IntArray, IntArray]:
    """The different nodes (k,) at the corners, ascending, and the corners (m, c) by their places among these. Nodes are
    numbers below n_nodes."""
    m, c = corners.shape
    place = np.zeros(n_nodes, dtype=np.int64)
    for p in range(m):
        for a in range(c):
            place[corners[p, a]] = 1
    nodes, own = np.flatnonzero(place), np.empty((m, c), dtype=np.int64)
    for k, node in enumerate(nodes):
        place[node] = k
    for p in range(m):
        for a in range(c):
            own[p, a] = place[corners[p, a]]
    return nodes, own


def _weighted(values: Array, corners: IntArray, weights: Array) -> Array:
    return np.einsum("mc,mc...->m...", weights, values[corners])


@summing(reference=_weighted)
def means(values: Array, corners: IntArray, weights: Array) -> Array:
    """The weighted means (m, ...) of values (k, ...) of nodes; weights (m, c)."""
    m, c = corners.shape
    flat = values.reshape(len(values), -1)
    result = np.zeros((m, flat.shape[1]))
    for p in range(m):
        for a in range(c):
            node, share = corners[p, a], weights[p, a]
            for i in range(flat.shape[1]):
                result[p, i] += share * flat[node, i]
    return result.reshape((m,) + values.shape[1:])  # noqa: RUF005 (the compiler knows no unpacking)


def _blocks_on_nodes(blocks: Array, corners: IntArray, weights: Array, n_nodes: int) -> Array:
    result = np.zeros((n_nodes, blocks.shape[1], n_nodes, blocks.shape[2]))
    for corner, weight, block in zip(corners, weights, blocks, strict=True):
        for a, b in np.ndindex(len(corner), len(corner)):
            result[corner[a], :, corner[b]] += weight[a] * weight[b] * block
    size = n_nodes * blocks.shape[1]
    return result.reshape(size, size)


@summing(reference=_blocks_on_nodes)
def blocks_on_nodes(blocks: Array, corners: IntArray, weights: Array, n_nodes: int) -> Array:
    """N^T S N (n_nodes*dim, n_nodes*dim) of blocks S (m, dim, dim) of points, with their weights N (m, c) in nodes."""
    m, c = corners.shape
    dim = blocks.shape[1]
    result = np.zeros((n_nodes * dim, n_nodes * dim))
    for p in range(m):
        for a in range(c):
            for b in range(c):
                share = weights[p, a] * weights[p, b]
                row, column = corners[p, a] * dim, corners[p, b] * dim
                for i in range(dim):
                    for j in range(dim):
                        result[row + i, column + j] += share * blocks[p, i, j]
    return result


def _both(x: Array, reach: Array, corners: IntArray, weights: Array) -> tuple[Array, Array]:
    return _weighted(x, corners, weights), _weighted(reach, corners, weights)


@summing(reference=_both)
def bounded_means(x: Array, reach: Array, corners: IntArray, weights: Array) -> tuple[Array, Array]:
    """The weighted means (m, dim) and (m,) of positions x (k, dim) of nodes and of a bound on each, reach (k,)."""
    m, c = corners.shape
    dim = x.shape[1]
    position, bound = np.zeros((m, dim)), np.zeros(m)
    for p in range(m):
        for k in range(c):
            node, share = corners[p, k], weights[p, k]
            bound[p] += share * reach[node]
            for a in range(dim):
                position[p, a] += share * x[node, a]
    return position, bound


def _added(values: Floats, corners: IntArray, weights: Array, n: int) -> Floats:
    total = np.zeros((n, values.shape[1]), values.dtype)
    np.add.at(total, corners, weights[..., None].astype(values.dtype) * values[:, None])
    return total


@summing(reference=_added)
def shared(values: Floats, corners: IntArray, weights: Array, n: int) -> Floats:
    """The transpose of `means`: what n nodes have of values (m, k) on points, (n, k) in their precision."""
    m, c = corners.shape
    total = np.zeros((n, values.shape[1]), values.dtype)
    for p in range(m):
        for a in range(c):
            node, share = corners[p, a], values.dtype.type(weights[p, a])
            for i in range(values.shape[1]):
                total[node, i] += share * values[p, i]
    return total
