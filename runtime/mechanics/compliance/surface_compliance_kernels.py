"""Compiled kernels of the surface compliance. They read only the entries of the contact nodes in use, some tens."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled, summing
from softprint.runtime.linalg.means import numbered

Floats = NDArray[np.floating[Any]]


class NodalCompliance(NamedTuple):
    """The compliance N G N^T among m points, by that of the k contact nodes at their corners, which are fewer: on each
    facet there is more than one point. among_nodes: G (k*dim, k*dim) [m/N], symmetric; corners: (m, c) places among
    these nodes; shares: N (m, c)."""

    among_nodes: Floats
    corners: IntArray
    shares: Array

    @classmethod
    def at_nodes(cls, G: Floats, dim: int) -> NodalCompliance:
        """Of points that are the nodes themselves."""
        k = len(G) // dim
        return cls(G, np.arange(k)[:, None], np.ones((k, 1)))

    def taken(self, points: IntArray, dim: int) -> NodalCompliance:
        """Among some of the points (n,), with the nodes at their corners alone."""
        nodes, corners = numbered(self.corners[points], len(self.among_nodes) // dim)
        return NodalCompliance(submatrix(self.among_nodes, nodes, dim), corners, self.shares[points])


def _sparse_products(index: IntArray, forces: Array, operator: Array, share: Any, near: Any) -> Array:
    """(P^T f) times the operator, plus N f, with sparse P and N^T."""
    n_anchors, dim, size = operator.shape
    P = csr_matrix(share[::-1], shape=(len(share[0]) - 1, n_anchors))
    N_T = csr_matrix(near[::-1], shape=(len(near[0]) - 1, size))
    rows = index[:, None] * dim + np.arange(dim)
    return np.einsum("kas,ka->s", operator, P[index].T @ forces) + N_T[rows.ravel()].T @ forces.ravel()


@summing(reference=_sparse_products)
def apply(
    index: IntArray,
    forces: NDArray[Any],
    operator: NDArray[np.float32],
    share: tuple[NDArray[np.int32], NDArray[np.int32], Array],
    near: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]],
) -> NDArray[Any]:
    """sum_j G_Xj forces_j, flat: (n_nodes*dim,) in the type of forces (m, dim), on some of the contact nodes (m,).

    operator: (n_anchors, dim, n_nodes*dim); share, near: row starts, columns and entries of P and N^T of
    `SurfaceCompliance`.
    """
    n_anchors, dim, size = operator.shape
    total = np.zeros(size, dtype=forces.dtype)
    shared = np.zeros((n_anchors, dim), dtype=forces.dtype)
    starts, columns, entries = near
    for j in range(len(index)):
        for entry in range(share[0][index[j]], share[0][index[j] + 1]):
            shared[share[1][entry]] += share[2][entry] * forces[j]
        # The rows of one contact node have their entries in the same columns.
        first = starts[index[j] * dim]
        count = starts[index[j] * dim + 1] - first
        for i in range(dim):
            row, force = entries[first + i * count : first + (i + 1) * count], forces[j, i]
            for entry in range(count):
                total[columns[first + entry]] += row[entry] * force
    for anchor in range(n_anchors):
        force = shared[anchor]
        if not force.any():
            continue
        column = operator[anchor]
        # All axes in one pass over memory, which limits the speed.
        if dim == 3:
            for at in range(size):
                total[at] += force[0] * column[0, at] + force[1] * column[1, at] + force[2] * column[2, at]
        else:
            for at in range(size):
                total[at] += force[0] * column[0, at] + force[1] * column[1, at]
    return total


def _gathered(pairs: NDArray[np.float32], index: IntArray) -> NDArray[np.float32]:
    size = len(index) * pairs.shape[2]
    return pairs[np.ix_(index, index)].transpose(0, 2, 1, 3).reshape(size, size)


@compiled(reference=_gathered)
def gathered(pairs: NDArray[np.float32], index: IntArray) -> NDArray[np.float32]:
    """G (m*dim, m*dim) [m/N] among some of the contact nodes (m,); pairs: G (n_contact, n_contact, dim, dim)."""
    m, dim = len(index), pairs.shape[2]
    result = np.empty((m, dim, m, dim), dtype=pairs.dtype)
    for i in range(m):
        for j in range(m):
            G = pairs[index[i], index[j]]
            for a in range(dim):
                # In 2D the second entry is written twice.
                result[i, a, j, 0], result[i, a, j, 1] = G[a, 0], G[a, 1]
                result[i, a, j, dim - 1] = G[a, dim - 1]
    return result.reshape(m * dim, m * dim)


def _some(G: Floats, nodes: IntArray, dim: int) -> Floats:
    rows = (nodes[:, None] * dim + np.arange(dim)).ravel()
    return G[np.ix_(rows, rows)]


@compiled(reference=_some)
def submatrix(G: Floats, nodes: IntArray, dim: int) -> Floats:
    """G (n*dim, n*dim) among some of the nodes (n,)."""
    n = len(nodes)
    result = np.empty((n * dim, n * dim), G.dtype)
    for i in range(n):
        for a in range(dim):
            row, into = G[nodes[i] * dim + a], result[i * dim + a]
            for j in range(n):
                for b in range(dim):
                    into[j * dim + b] = row[nodes[j] * dim + b]
    return result


@summing(
    reference=lambda pairs, at, index, forces: np.einsum("ijab,jb->ia", pairs[np.ix_(at, index)], forces)
)
def displacement(pairs: NDArray[np.float32], at: IntArray, index: IntArray, forces: Array) -> Array:
    """sum_j G_ij phi_j (n, dim) [m] at the contact nodes `at` (n,) by forces (m, dim) on the contact nodes `index`
    (m,); pairs: as for `gathered`."""
    n, dim = len(at), pairs.shape[2]
    result = np.empty((n, dim))
    for i in range(n):
        x = y = z = 0.0
        for j in range(len(index)):
            G, f = pairs[at[i], index[j]], forces[j]
            if dim == 3:
                x += G[0, 0] * f[0] + G[0, 1] * f[1] + G[0, 2] * f[2]
                y += G[1, 0] * f[0] + G[1, 1] * f[1] + G[1, 2] * f[2]
                z += G[2, 0] * f[0] + G[2, 1] * f[1] + G[2, 2] * f[2]
            else:
                x += G[0, 0] * f[0] + G[0, 1] * f[1]
                z += G[1, 0] * f[0] + G[1, 1] * f[1]
        # In 2D the second entry is written twice.
        result[i, 0], result[i, 1], result[i, dim - 1] = x, y, z
    return result


def _displacement_reference(
    pairs: NDArray[np.float32], at: IntArray, index: IntArray, forces: Array
) -> Array:
    return np.asarray(np.einsum("jiba,jb->ia", pairs[np.ix_(index, at)], forces))


@summing(reference=_displacement_reference)
def displacement_of_many(pairs: NDArray[np.float32], at: IntArray, index: IntArray, forces: Array) -> Array:
    """The same as `displacement` from the rows of few contact nodes with forces, G_ij = G_ji^T: each row is read
    once, for many nodes `at`."""
    n, dim = len(at), pairs.shape[2]
    result = np.zeros((n, dim))
    for j in range(len(index)):
        row, f = pairs[index[j]], forces[j]
        if dim == 3:
            for i in range(n):
                G = row[at[i]]
                result[i, 0] += G[0, 0] * f[0] + G[1, 0] * f[1] + G[2, 0] * f[2]
                result[i, 1] += G[0, 1] * f[0] + G[1, 1] * f[1] + G[2, 1] * f[2]
                result[i, 2] += G[0, 2] * f[0] + G[1, 2] * f[1] + G[2, 2] * f[2]
        else:
            for i in range(n):
                G = row[at[i]]
                result[i, 0] += G[0, 0] * f[0] + G[1, 0] * f[1]
                result[i, 1] += G[0, 1] * f[0] + G[1, 1] * f[1]
    return result


def _copied(all_pairs: NDArray[np.float32], known: IntArray, first: int, pairs: NDArray[np.float32]) -> Any:
    m, new = len(known), known[first:]
    pairs[first:m, :m] = all_pairs[np.ix_(new, known)]
    pairs[:m, first:m] = all_pairs[np.ix_(new, known)].transpose(1, 0, 3, 2)
    return pairs


@compiled(reference=_copied)
def copy_pairs(
    all_pairs: NDArray[np.float32], known: IntArray, first: int, pairs: NDArray[np.float32]
) -> None:
    """Write G between the contact nodes `known` (m,) and those of them from the first on into the first m rows and
    columns of `pairs`. Only rows of all_pairs are read: G_ij = G_ji^T."""
    dim = pairs.shape[2]
    for i in range(first, len(known)):
        row = all_pairs[known[i]]
        for j in range(len(known)):
            G, into, mirrored = row[known[j]], pairs[i, j], pairs[j, i]
            for a in range(dim):
                for b in range(dim):
                    into[a, b] = G[a, b]
                    mirrored[b, a] = G[a, b]
