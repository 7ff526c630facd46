"""Gradients of the subspace basis at nodes, by moving least squares over the cells around them.

The gradient of a piecewise linear field is constant in a cell. At a node X an affine function of the place is fitted to
the gradients g_c of the cells around it, at their centroids, weighted by the volumes v_c of the cells (Mueller et al.
2004, as in thesis 4.2.1), and evaluated at X:

    sum_c v_c |p(X_c) . a - g_c|^2 -> min,    p(Y) = (1, Y - X),    g(X) = a_0.

Unlike the volume-weighted mean it is exact for gradients that vary linearly, at the boundary too. Where the centroids
around a node do not span the space, the fit of least norm is taken, in lengths of the cells: with one cell its own
gradient.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.mesh import Mesh

# Directions in which the centroids spread by less than this share of the size of a cell are left out of the fit.
_FLAT = 0.05


def least_squares_weights(mesh: Mesh) -> sp.csr_matrix:
    """(n_nodes, n_cells): from values of the cells to values at the nodes; rows sum to one."""
    corners = mesh.dim + 1
    around = sp.csr_matrix(
        (np.ones(mesh.cells.size), (mesh.cells.ravel(), np.repeat(np.arange(mesh.n_cells), corners))),
        shape=(mesh.n_nodes, mesh.n_cells),
    )
    around.sort_indices()
    counts, values = np.diff(around.indptr), np.empty(mesh.cells.size)
    for count in np.unique(counts):  # nodes with as many cells together
        nodes = np.flatnonzero(counts == count)
        entries = around.indptr[nodes][:, None] + np.arange(count)
        values[entries] = _weights(mesh, nodes, around.indices[entries])
    return sp.csr_matrix((values, around.indices, around.indptr), shape=around.shape)


def _weights(mesh: Mesh, nodes: IntArray, cells: IntArray) -> Array:
    """(n, k) of nodes (n,) with cells (n, k) around each."""
    volume = mesh.cell_volumes[cells]
    length = volume.mean(axis=1)[:, None, None] ** (1.0 / mesh.dim)
    away = (mesh.cell_centroids[cells] - mesh.points[nodes][:, None]) / length
    root = np.sqrt(volume / volume.sum(axis=1, keepdims=True))
    # a_0 of the fit: the weighted mean, less the slope times the mean distance.
    mean = np.einsum("nk,nkd->nd", root**2, away)
    slopes = np.linalg.pinv(root[:, :, None] * (away - mean[:, None]), rcond=_FLAT)
    about = np.einsum("nd,ndk->nk", mean, slopes) * root
    return root**2 - (about - root**2 * about.sum(axis=1, keepdims=True))


def basis_gradient_at_nodes(body: ReducedBody) -> Array:
    """(n_nodes, n_rows, dim) [1/m]: with it F_ij = sum_r rows_ri gradient_rj of the reduced body at its nodes."""
    mesh, n_rows = body.mesh, body.n_rows
    of_cells = np.matmul(body.basis[mesh.cells].transpose(0, 2, 1), mesh.cell_gradients)
    flat = least_squares_weights(mesh) @ of_cells.reshape(mesh.n_cells, -1)
    return np.asarray(flat).reshape(mesh.n_nodes, n_rows, mesh.dim)
