"""Data-oblivious cubature: a few weighted cells represent the whole body (thesis 3.7.2).

As in the thesis, cells are sampled uniformly, and no example deformations are needed. The weights differ. The thesis
integrates the biharmonic coordinates of the samples (eq. 3.14, :func:`interpolation_weights`). Here the weights are
fitted to integrate the terms of which every elastic energy of the subspace consists. To second order that energy is
quadratic in the products of basis gradients, so the moments

    M_c = mu_c D_c (x) D_c,    D_c = grad U in cell c, (n_rows, dim),

are integrated in the least-squares sense by nonnegative weights, weakly regularised towards the volumes that the
samples represent. The inner product of two moments is mu_c mu_c' (D_c : D_c')^2, so moments are never formed. On the
small Jelly with ten cells a row this leaves a third of the force error of eq. 3.14 (``python -m benchmarks.cubature``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import igl
import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray, scatter_sum
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.rotations import rotation_dofs
from softprint.runtime.elasticity.elastic_energy import elastic_energy, elastic_gradient
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity
from softprint.runtime.mesh import Mesh

# Regularisation of the weights towards the samples' own volumes, relative to the moments. From 0.01 to 0.1 the measured
# error hardly changes; below 0.01, weights vanish or grow to several times the mean.
RIDGE = 0.03
_CHUNK = 16384  # cells whose kernel values are in memory at once


@dataclass(frozen=True, eq=False)
class Cubature:
    """cells: (m,) cell indices, ascending; weights: (m,) [m^dim], positive: E = sum_i w_i Psi(F_i) (thesis
    eq. 3.13).

    energy_error, force_error: mean relative errors against full integration, measured when the body was
    built.
    """

    cells: IntArray
    weights: Array
    energy_error: float
    force_error: float


def build_cubature(
    mesh: Mesh,
    basis: Array,
    handles: Handles,
    material: Material,
    points_per_row: int,
    rng: np.random.Generator,
) -> Cubature:
    """About points_per_row cells for each row of the basis (n_nodes, n_rows), and their measured errors.

    Cells inside a rigid frame store no energy and are never sampled; each material region has its own samples, in
    proportion to its volume. If more samples are requested than there are cells, all cells are integrated.
    """
    cells, weights = choose_cubature(mesh, basis, handles, material, points_per_row * handles.n_rows)
    states = random_states(mesh, handles, rng)
    energy_error, force_error = cubature_error(mesh, basis, handles, material, cells, weights, states)
    return Cubature(cells, weights, energy_error, force_error)


def choose_cubature(
    mesh: Mesh, basis: Array, handles: Handles, material: Material, count: int
) -> tuple[IntArray, Array]:
    """Cells (m,) and weights (m,) with m at most ``count`` (plus one for each small material region)."""
    elastic = elastic_cells(mesh, handles)
    if count >= len(elastic):
        return elastic, mesh.cell_volumes[elastic]
    cells, volumes = [], []
    for region, share in _shares(mesh, material, elastic, count):
        chosen = uniform_cells(mesh, region, share)
        cells.append(chosen)
        volumes.append(nearest_volumes(mesh, region, chosen))
    sampled, volume = np.concatenate(cells), np.concatenate(volumes)
    weights = moment_weights(mesh, basis, material, elastic, sampled, volume)
    order = np.argsort(sampled)
    order = order[weights[order] > 0]
    return sampled[order], weights[order]


def elastic_cells(mesh: Mesh, handles: Handles) -> IntArray:
    """Indices of the cells that can deform: all but those with every corner in one frame's region."""
    rigid = np.zeros(mesh.n_cells, dtype=bool)
    for frame in handles.frames:
        inside = np.zeros(mesh.n_nodes, dtype=bool)
        inside[frame.nodes] = True
        rigid |= inside[mesh.cells].all(axis=1)
    return np.flatnonzero(~rigid)


def _shares(mesh: Mesh, material: Material, cells: IntArray, count: int) -> list[tuple[IntArray, int]]:
    """The material regions of the cells, each with its number of samples: by volume, at least one."""
    local = material.at(cells)
    parameters = np.column_stack(
        [np.broadcast_to(value, len(cells)) for value in (local.young, local.poisson)]
    )
    _, region = np.unique(parameters, axis=0, return_inverse=True)
    volume = scatter_sum(region, mesh.cell_volumes[cells], int(region.max()) + 1)
    samples = np.maximum(1, np.floor(count * volume / volume.sum())).astype(int)
    return [(cells[region.reshape(-1) == index], int(share)) for index, share in enumerate(samples)]


def uniform_cells(mesh: Mesh, cells: IntArray, count: int) -> IntArray:
    """``count`` of the cells, uniform in volume: farthest points, then one step of Lloyd's iteration.

    Farthest points crowd at the surface; the step towards the centroid of each sample's region moves them inward.
    """
    centroids, volumes = mesh.cell_centroids[cells], mesh.cell_volumes[cells]
    samples = centroids[farthest_points(centroids, count)]
    _, owner = cKDTree(samples).query(centroids)
    mass = scatter_sum(owner, volumes, len(samples))
    middles = [
        scatter_sum(owner, volumes * centroids[:, axis], len(samples)) / mass for axis in range(mesh.dim)
    ]
    _, nearest = cKDTree(centroids).query(np.column_stack(middles))
    return cells[np.unique(nearest)]


def nearest_volumes(mesh: Mesh, cells: IntArray, sampled: IntArray) -> Array:
    """(m,) volume of the cells nearest to each sampled cell [m^dim]."""
    _, owner = cKDTree(mesh.cell_centroids[sampled]).query(mesh.cell_centroids[cells])
    return scatter_sum(owner, mesh.cell_volumes[cells], len(sampled))


def moment_weights(
    mesh: Mesh, basis: Array, material: Material, cells: IntArray, sampled: IntArray, volumes: Array
) -> Array:
    """Nonnegative weights (m,) of the sampled cells [m^dim] that integrate mu D (x) D over the cells; see
    above.

    With w = y * volumes, minimises |sum_c w_c M_c - integral M|^2 / |sum_c volumes_c M_c|^2 + RIDGE^2 mean
    (y - 1)^2.
    """
    shear = np.broadcast_to(material.lame_mu, mesh.n_cells)

    def moments(which: IntArray) -> Array:
        gradient = ReducedElasticity.on_cells(
            mesh, basis, material, which, mesh.cell_volumes[which]
        ).basis_gradient
        return np.sqrt(shear[which])[:, None] * gradient.reshape(len(which), -1)

    own = moments(sampled)
    integral = np.zeros(len(sampled))
    for start in range(0, len(cells), _CHUNK):
        part = cells[start : start + _CHUNK]
        integral += (own @ moments(part).T) ** 2 @ mesh.cell_volumes[part]
    kernel = volumes[:, None] * (own @ own.T) ** 2 * volumes
    scale, pull = kernel.sum(), RIDGE**2 / len(sampled)
    lower = np.linalg.cholesky(kernel / scale + pull * np.eye(len(sampled)))
    shares, _ = nnls(lower.T, np.linalg.solve(lower, volumes * integral / scale + pull))
    return shares * volumes


def interpolation_weights(mesh: Mesh, sampled: IntArray) -> Array:
    """The thesis's weights, eq. 3.14: integrals of the biharmonic coordinates of the samples (m,) [m^dim].

    The coordinates are defined at nodes, so each sampled cell is represented by the node nearest to its centroid
    (samples that share a node share its weight). For comparison only; the weights may be negative.
    """
    _, nearest = cKDTree(mesh.points).query(mesh.cell_centroids[sampled])
    nodes, owner, shared = np.unique(nearest, return_inverse=True, return_counts=True)
    coordinates = igl.biharmonic_coordinates(mesh.points, mesh.cells, [[int(node)] for node in nodes], 2)
    return ((mesh.node_volumes @ coordinates) / shared)[owner.reshape(-1)]


def random_states(mesh: Mesh, handles: Handles, rng: np.random.Generator, count: int = 8) -> list[Array]:
    """Random handle rows for measurements: normally distributed, displacements of 5 % of the body's size, rotations of
    0.1 rad."""
    rest = handles.rest_rows(mesh.points)
    spread = dof_scale(mesh, handles)
    return [handles.retract(rest, spread * rng.normal(size=handles.n_dofs)) for _ in range(count)]


def dof_scale(mesh: Mesh, handles: Handles) -> Array:
    """(n_dofs,) scale of each coordinate: 5 % of the body's size for translations [m], 0.1 for rotations [rad]."""
    spin = rotation_dofs(mesh.dim)
    frame = [0.05 * mesh.size] * mesh.dim + [0.1] * spin
    return np.concatenate(
        [np.full(handles.n_points * mesh.dim, 0.05 * mesh.size), *([frame] * len(handles.frames))]
    )


def cubature_error(
    mesh: Mesh,
    basis: Array,
    handles: Handles,
    material: Material,
    cells: IntArray,
    weights: Array,
    states: Sequence[Array],
) -> tuple[float, float]:
    """Mean relative errors (energy, force) of the cubature against full integration at the given handle rows.

    |E - E_full| / |E_full|, and |f - f_full| / |f_full| of the forces on the minimal coordinates, weighted by
    :func:`dof_scale` so that torques and forces are comparable.
    """
    reduced = ReducedElasticity.on_cells(mesh, basis, material, cells, weights)
    scale = dof_scale(mesh, handles)
    errors: list[tuple[float, float]] = []
    for rows in states:
        positions, F = basis @ rows, reduced.deformation_gradients(rows)
        tangent = handles.tangent(rows) * scale
        energy = elastic_energy(mesh, material, positions)
        force = tangent.T @ (basis.T @ elastic_gradient(mesh, material, positions)).ravel()
        difference = tangent.T @ reduced.gradient(F).ravel() - force
        force_error = float(np.linalg.norm(difference) / np.linalg.norm(force))
        errors.append((abs(reduced.energy(F) / energy - 1.0), force_error))
    mean = np.mean(errors, axis=0)
    return float(mean[0]), float(mean[1])
