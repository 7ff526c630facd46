"""The shape quality of a mesh's cells, and whether its surface is closed."""

from __future__ import annotations

from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.mesh import Mesh


def mesh_facts(mesh: Mesh) -> dict[str, Any]:
    """The main figures of a body's mesh. Angles are between faces in 3D (dihedral), between edges in 2D."""
    angles, shape = cell_angles(mesh), mean_ratio(mesh)
    unit, boundary = ("m^2", "m") if mesh.dim == 2 else ("m^3", "m^2")
    edges = facet_edges(mesh.facets)
    extent = np.ptp(mesh.points, axis=0)
    return {
        "dimension": mesh.dim,
        "nodes": mesh.n_nodes,
        "triangles" if mesh.dim == 2 else "tetrahedra": mesh.n_cells,
        "extent [m]": [float(length) for length in extent],
        f"{'area' if mesh.dim == 2 else 'volume'} [{unit}]": float(mesh.cell_volumes.sum()),
        "mean edge of a cell [m]": float(np.mean(mean_edges(mesh))),
        "smallest and largest angle [degrees]": [float(angles.min()), float(angles.max())],
        "shape (1 is regular)": {"worst": float(shape.min()), "median": float(np.median(shape))},
        "surface nodes": len(mesh.surface_nodes),
        f"surface [{boundary}]": float(mesh.surface_areas.sum()),
        "watertight": bool((edges == 2).all()),
    }


def cell_angles(mesh: Mesh) -> Array:
    """(n_cells, dim (dim+1) / 2) [degrees]: dihedral angles in 3D, corner angles in 2D.

    The gradients of two hat functions are the inward normals of the facets opposite to their corners, so the
    angle between these facets has cos = -G_a.G_b / |G_a||G_b|.
    """
    normals = mesh.cell_gradients / np.linalg.norm(mesh.cell_gradients, axis=2, keepdims=True)
    first, second = np.triu_indices(mesh.dim + 1, 1)
    cosines = -(normals[:, first] * normals[:, second]).sum(axis=2)
    return np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))


def mean_ratio(mesh: Mesh) -> Array:
    """(n_cells,) mean ratio of Liu and Joe (1994), 1 for a regular simplex, 0 for a flat one:
    12 (3 V)^(2/3) / sum l^2 in 3D, 4 sqrt(3) A / sum l^2 in 2D."""
    squares = _edge_squares(mesh).sum(axis=1)
    if mesh.dim == 2:
        return 4.0 * np.sqrt(3.0) * mesh.cell_volumes / squares
    return 12.0 * (3.0 * mesh.cell_volumes) ** (2.0 / 3.0) / squares


def mean_edges(mesh: Mesh) -> Array:
    """(n_cells,) mean length of the edges of each cell [m]."""
    return np.sqrt(_edge_squares(mesh)).mean(axis=1)


def _edge_squares(mesh: Mesh) -> Array:
    first, second = np.triu_indices(mesh.dim + 1, 1)
    along = mesh.points[mesh.cells[:, first]] - mesh.points[mesh.cells[:, second]]
    return np.asarray((along * along).sum(axis=2))


def facet_edges(facets: IntArray) -> IntArray:
    """Number of facets at each edge of a triangle surface, or at each end of the segments of an outline: 2 everywhere
    if it is closed."""
    if facets.shape[1] == 2:
        return np.unique(facets, return_counts=True)[1]
    edges = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]
