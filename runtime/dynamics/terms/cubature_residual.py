"""Cubature residual stiffness: the stiffness of a statically condensed body at rest that its cubature misses.

In a region r with rotation R_r, with z = (d, R_r^T g) and the strain d = R_r^T rows - rest in the frame of the region,

    E = sum_r 1/2 z^T M_r z,    M_r = P^T (V^T K_r V - sum_c w_c B_c^T A_c B_c) P,

with V = (U + L, w) the displacements of the nodes by z, K_r the stiffness at rest of all cells of the region, and c the
cubature cells among them. Far regions of a body rotate relative to each other, so no single d is small everywhere; but
a stiffness between near handles only requires that these rotate alike. Where they do not, as at a joint, P
(`Handles.linearised_frames`) lets a frame that has turned by a finite angle count as turned by its sine. By its cosine,
which is a squeeze in d, E would fall without bound where M_r is indefinite. Frames far from a region are lumped
(`handle_sparsity.py`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.cubature import elastic_cells
from softprint.runtime.body.handle_sparsity import HandleSparsity
from softprint.runtime.compiled import summing
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity
from softprint.runtime.mechanics.body_regions import BodyRegions
from softprint.runtime.mechanics.compliance.null_space_compliance import rest_stiffness
from softprint.runtime.mechanics.static_condensation import StaticCondensation

Floats = NDArray[np.floating[Any]]


class Expansion(NamedTuple):
    """E = value + slope . change + 1/2 change . stiffness . change, for a change (n_rows*dim,) of the rows."""

    value: float
    slope: Array
    stiffness: Array


class CubatureResidual:
    """The M_r of a body. condensation: of all its nodes; by_unknowns: B (m, dim*dim, n_rows*dim + dim) of the cells
    of the cubature, without rotation."""

    def __init__(
        self,
        body: ReducedBody,
        condensation: StaticCondensation,
        elasticity: ReducedElasticity,
        by_unknowns: Array,
    ) -> None:
        self._condensation = condensation
        regions, sparsity = BodyRegions(body, condensation), HandleSparsity(body)
        self._corotation = regions.corotation
        n_rows, dim = condensation.rest_rows.shape
        jacobian = _spread(body) + condensation.unrotated_jacobian()
        moved = np.concatenate([jacobian, condensation.weight[:, :, None]], axis=2)
        # Without the cells inside frames, which rotate by finite angles without strain.
        elastic = elastic_cells(body.mesh, body.handles)
        places = body.mesh.cell_centroids
        of_elastic, of_cubature = regions.of(places[elastic]), regions.of(places[body.cubature.cells])
        linearised = scipy.linalg.block_diag(body.handles.linearised_frames, np.eye(dim))
        blocks, rows = [], []
        for region in range(regions.count):
            cells, own = elastic[of_elastic == region], of_cubature == region
            nodes = np.unique(body.mesh.cells[cells])
            dofs = (nodes[:, None] * dim + np.arange(dim)).ravel()
            V = moved[nodes].reshape(len(dofs), -1)
            K = rest_stiffness(body, cells)[dofs][:, dofs]
            B = by_unknowns[own].reshape(-1, V.shape[1])
            stretched = np.tile(np.eye(dim), (len(nodes), 1)) * body.mesh.points[nodes].reshape(-1, 1)
            unit = float((stretched * (K @ stretched)).sum() / dim)
            whole = V.T @ (K @ V)
            near = sparsity.near_part(whole[: n_rows * dim, : n_rows * dim], unit)
            residual = sparsity.lumped(whole - at_rest(elasticity.take(own), B), near)
            residual = sparsity.lumped(residual.T, near)
            residual = (linearised.T @ residual @ linearised).reshape(n_rows + 1, dim, n_rows + 1, dim)
            kept = sparsity.rows(near)
            rows.append(kept)
            kept = np.append(kept, n_rows)
            blocks.append(residual[kept][:, :, kept].transpose(0, 1, 3, 2).ravel())
        # In single precision, as memory bandwidth limits the speed.
        self._blocks, self._rows = np.concatenate(blocks).astype(np.float32), np.concatenate(rows)
        self._first = np.cumsum([0, *(len(kept) for kept in rows)])

    def about(self, frame_rows: Array) -> Expansion:
        """E about the frame rows (n_rows, dim), with their rotations fixed."""
        own, rotations = self._condensation, self._corotation.rotations(frame_rows)
        unknowns = own.centred(frame_rows), own.centred_rest_rows, own.gravity
        return Expansion(*_about(self._blocks, self._first, self._rows, *unknowns, rotations))


def at_rest(elasticity: ReducedElasticity, B: Array) -> Array:
    """sum_c w_c B^T A B (k, k) with the cells at rest, B (m*dim*dim, k)."""
    dim = elasticity.hat_gradients.shape[2]
    rest = np.broadcast_to(np.eye(dim), (elasticity.n_cells, dim, dim)).copy()
    return stiffness(elasticity, rest, B)


def stiffness(elasticity: ReducedElasticity, F: Array, B: Floats) -> Array:
    """sum_c w_c B^T A B (k, k) of B (m*dim*dim, k), in the precision of B."""
    size = F.shape[1] * F.shape[2]
    tangent = elasticity.material.tangent(F).reshape(-1, size, size)
    tangent *= elasticity.weights[:, None, None]
    moved = (tangent.astype(B.dtype) @ B.reshape(len(F), size, -1)).reshape(B.shape)
    return np.asarray(B.T @ moved, dtype=np.float64)


def _spread(body: ReducedBody) -> Array:
    """U by axis (n_nodes, dim, n_rows, dim)."""
    return np.einsum("nr,ab->narb", body.basis, np.eye(body.dim))


@summing
def _about(
    blocks: Floats,
    first: IntArray,
    rows: IntArray,
    frame_rows: Array,
    rest: Array,
    gravity: Array,
    rotations: Array,
) -> tuple[float, Array, Array]:
    """1/2 z^T M z, R M z and R M R^T by the handle rows, summed over the regions. Region r depends on the rows first[r]
    to first[r + 1] of `rows`; its M (k + 1, dim, dim, k + 1) is over (row, axis, axis of the other row, other row),
    with gravity as the last row of both. blocks: M of all regions, flat."""
    n_rows, dim = frame_rows.shape
    value, slope, total = 0.0, np.zeros((n_rows, dim)), np.zeros((n_rows, dim, n_rows, dim))
    at = 0
    for region in range(len(rotations)):
        R, own = rotations[region], rows[first[region] : first[region + 1]]
        k = len(own)
        z = np.zeros((dim, k + 1))
        for b in range(dim):
            for a in range(dim):
                for s in range(k):
                    z[b, s] += frame_rows[own[s], a] * R[a, b]
                z[b, k] += gravity[a] * R[a, b]
            for s in range(k):
                z[b, s] -= rest[own[s], b]
        size = dim * dim * (k + 1)
        M = blocks[at : at + (k + 1) * size].reshape(k + 1, dim, dim, k + 1)
        at += (k + 1) * size
        # In 2D the third of every three products is zero.
        left, last = np.empty((dim, k + 1)), dim - 1
        across = np.zeros((dim, 3))
        across[:, :dim] = R
        for r in range(k + 1):
            for a in range(dim):
                force = 0.0
                for b in range(dim):
                    row, along = M[r, a, b], z[b]
                    for s in range(k + 1):
                        force += row[s] * along[s]
                value += 0.5 * force * z[a, r]
                if r < k:
                    for i in range(dim):
                        slope[own[r], i] += R[i, a] * force
            if r == k:
                continue
            # M is symmetric: only one of every two blocks is rotated.
            for i in range(dim):
                u, v, w = across[i]
                for b in range(dim):
                    of_x, of_y, of_z, into = M[r, 0, b], M[r, 1, b], M[r, last, b], left[b]
                    for s in range(r + 1):
                        into[s] = u * of_x[s] + v * of_y[s] + w * of_z[s]
                of_x, of_y, of_z, by_row = left[0], left[1], left[last], total[own[r], i]
                for j in range(dim):
                    u, v, w = across[j]
                    for s in range(r + 1):
                        by_row[own[s], j] += u * of_x[s] + v * of_y[s] + w * of_z[s]
    full = total.reshape(n_rows * dim, n_rows * dim)
    for r in range(n_rows):
        for i in range(dim):
            for s in range(r):
                for j in range(dim):
                    full[s * dim + j, r * dim + i] = full[r * dim + i, s * dim + j]
    return value, slope.ravel(), full
