"""What the cubature of a body in its internal equilibrium misses at rest, region by region.

In a region r that has turned by R_r, with z = (d, R_r^T g) and the strain d = R_r^T rows - rest as seen from there,

    E = sum_r 1/2 z^T M_r z,    M_r = V^T K_r V - sum_c w_c B_c^T A_c B_c,

with V = (U + L, w) what z moves every node by, K_r the stiffness at rest of all cells of the region, and c those of
the cubature among them. Far regions of a body turn against each other, and no single d is small everywhere; but a
stiffness that knows the near handles only needs no more than that these turn alike.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.body.body import ReducedBody
from runtime.body.cubature import elastic_cells
from runtime.compiled import summing
from runtime.corrections.internal_response import InternalResponse
from runtime.corrections.rest_response import rest_stiffness
from runtime.dynamics.body_regions import BodyRegions
from runtime.elasticity.reduced_elasticity import ReducedElasticity


class Expansion(NamedTuple):
    """E = value + slope . change + 1/2 change . stiffness . change, of a change (n_rows*dim,) of the rows."""

    value: float
    slope: Array
    stiffness: Array


class MissedStiffness:
    """The M_r of a body. internal: of all its nodes; by_unknowns: B (m*dim*dim, n_rows*dim + dim) of the cells of the
    cubature, unturned."""

    def __init__(
        self,
        body: ReducedBody,
        internal: InternalResponse,
        elasticity: ReducedElasticity,
        by_unknowns: Array,
    ) -> None:
        self._internal = internal
        regions = BodyRegions(body, internal)
        self._turning = regions.turning
        n_rows, dim = internal.rest_rows.shape
        moved = np.concatenate([_spread(body) + internal.unturned(), internal.weight[:, :, None]], axis=2)
        # Not of the cells inside frames: these turn by finite angles, which are no strain.
        elastic = elastic_cells(body.mesh, body.handles)
        places = body.mesh.cell_centroids
        of_elastic, of_cubature = regions.of(places[elastic]), regions.of(places[body.cubature.cells])
        by_cell = by_unknowns.reshape(elasticity.n_cells, dim * dim, -1)
        self._missed = np.empty((regions.count, n_rows + 1, dim, n_rows + 1, dim))
        for region, missed in enumerate(self._missed):
            cells, own = elastic[of_elastic == region], of_cubature == region
            nodes = np.unique(body.mesh.cells[cells])
            dofs = (nodes[:, None] * dim + np.arange(dim)).ravel()
            V = moved[nodes].reshape(len(dofs), -1)
            K = rest_stiffness(body, cells)[dofs][:, dofs]
            counted = at_rest(elasticity.take(own), by_cell[own].reshape(-1, by_cell.shape[2]))
            missed[:] = (V.T @ (K @ V) - counted).reshape(missed.shape)

    def about(self, turn: Array) -> Expansion:
        """E about the turn (n_rows, dim), which is held."""
        internal, rotations = self._internal, self._turning.rotations(turn)
        strain = np.array([internal.strain(turn, rotation) for rotation in rotations])
        hanging = (internal.gravity @ rotations)[:, None]
        z = np.concatenate([strain, hanging], axis=1)
        return Expansion(*_about(self._missed, z, rotations))


def at_rest(elasticity: ReducedElasticity, B: Array) -> Array:
    """sum_c w_c B^T A B (k, k) with the cells at rest, B (m*dim*dim, k)."""
    dim = elasticity.hat_gradients.shape[2]
    rest = np.broadcast_to(np.eye(dim), (elasticity.n_cells, dim, dim)).copy()
    return stiffness(elasticity, rest, B)


def stiffness(elasticity: ReducedElasticity, F: Array, B: NDArray[np.floating[Any]]) -> Array:
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
def _about(missed: Array, z: Array, rotations: Array) -> tuple[float, Array, Array]:
    """1/2 z^T M z, R M z and R M R^T by the rows, summed over M (k, n_rows + 1, dim, n_rows + 1, dim)."""
    n_regions, n, dim = z.shape
    size = (n - 1) * dim
    value, slope, total = 0.0, np.zeros((n - 1, dim)), np.zeros((n - 1, dim, size))
    left = np.empty(size)
    for region in range(n_regions):
        turn, own = rotations[region], z[region].ravel()
        for r in range(n):
            for a in range(dim):
                row = missed[region, r, a].ravel()
                force = 0.0
                for column in range(n * dim):
                    force += row[column] * own[column]
                value += 0.5 * force * own[r * dim + a]
                if r < n - 1:
                    for i in range(dim):
                        slope[r, i] += turn[i, a] * force
        for r in range(n - 1):
            for i in range(dim):
                left[:] = 0.0
                for a in range(dim):
                    row, share = missed[region, r, a].ravel(), turn[i, a]
                    for column in range(size):
                        left[column] += share * row[column]
                summed = total[r, i]
                for s in range(0, size, dim):
                    for j in range(dim):
                        for b in range(dim):
                            summed[s + j] += left[s + b] * turn[j, b]
    return value, slope.ravel(), total.reshape(size, size)
