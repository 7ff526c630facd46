"""A simplex mesh at rest with derived quantities: volumes, gradients of the hat functions, the surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
import scipy.sparse as sp

from softprint.runtime.arrays import Array, IntArray, scatter_sum

# Facet k lies opposite corner k; the order of its corners makes the normal point out of a positive cell.
FACETS = {
    2: np.array([[1, 2], [2, 0], [0, 1]]),
    3: np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]),
}


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles (dim 2) or tetrahedra (dim 3) in their rest position, positively oriented.

    points: (n_nodes, dim) [m]; cells: (n_cells, dim+1) node indices. The constructor does not check its input:
    :func:`runtime.mesh.oriented_mesh` checks and repairs. Derived quantities are computed once, on first use.
    """

    points: Array
    cells: IntArray

    @property
    def dim(self) -> int:
        return int(self.points.shape[1])

    @property
    def n_nodes(self) -> int:
        return len(self.points)

    @property
    def n_cells(self) -> int:
        return len(self.cells)

    @cached_property
    def size(self) -> float:
        """Largest extent of the bounding box [m]."""
        return float(np.ptp(self.points, axis=0).max())

    @cached_property
    def cell_volumes(self) -> Array:
        """(n_cells,) area [m^2] or volume [m^3]."""
        return signed_volumes(self.points, self.cells)

    @cached_property
    def cell_centroids(self) -> Array:
        """(n_cells, dim) [m]."""
        return self.points[self.cells].mean(axis=1)

    @cached_property
    def cell_gradients(self) -> Array:
        """(n_cells, dim+1, dim) gradients of the hat functions [1/m]: F_ij = sum_a x_ai G_aj."""
        edges = self.points[self.cells[:, 1:]] - self.points[self.cells[:, :1]]
        others = np.linalg.inv(edges).transpose(0, 2, 1)
        return np.concatenate([-others.sum(axis=1, keepdims=True), others], axis=1)

    @cached_property
    def node_volumes(self) -> Array:
        """(n_nodes,) share of the volume lumped at each node."""
        return self.lump(self.cell_volumes)

    def lump(self, cell_values: Array) -> Array:
        """(n_nodes,) sums of cell values (n_cells,), each spread evenly over its cell's corners."""
        corners = self.dim + 1
        shares = np.repeat(cell_values / corners, corners)
        return scatter_sum(self.cells, shares, self.n_nodes)

    @cached_property
    def facets(self) -> IntArray:
        """(n_facets, dim) boundary edges or triangles, oriented with the normal outward."""
        local = FACETS[self.dim]
        every = self.cells[:, local].reshape(-1, self.dim)
        _, first, count = np.unique(np.sort(every, axis=1), axis=0, return_index=True, return_counts=True)
        return every[np.sort(first[count == 1])]

    @cached_property
    def facet_vectors(self) -> Array:
        """(n_facets, dim) outward normals times the facet's length [m] or area [m^2]."""
        return facet_vectors(self.points, self.facets)

    @cached_property
    def surface_nodes(self) -> IntArray:
        """(n_surface,) indices of the nodes on the boundary, ascending."""
        return np.unique(self.facets)

    @cached_property
    def surface_areas(self) -> Array:
        """(n_surface,) boundary length [m] or area [m^2] lumped at each surface node."""
        measure = np.linalg.norm(self.facet_vectors, axis=1)
        shares = np.repeat(measure / self.dim, self.dim)
        return scatter_sum(self.facets, shares, self.n_nodes)[self.surface_nodes]

    @property
    def surface_spacing(self) -> float:
        """The distance between surface nodes [m]: that of a square grid of as many nodes on the same area."""
        return float(self.surface_areas.sum() / len(self.surface_nodes)) ** (1.0 / (self.dim - 1))

    @cached_property
    def surface_normals(self) -> Array:
        """(n_surface, dim) unit outward normals at the surface nodes, averaged over facets by area."""
        normals = node_normals(self.points, self.facets)[self.surface_nodes]
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)

    @cached_property
    def surface_edges(self) -> IntArray:
        """(n_edges, 2) unique edges of the boundary, lower node first."""
        if self.dim == 2:
            pairs = self.facets
        else:
            pairs = self.facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        return np.unique(np.sort(pairs, axis=1), axis=0)

    @cached_property
    def nodal_gradient(self) -> tuple[sp.csr_matrix, ...]:
        """dim sparse matrices (n_nodes, n_nodes): nodal values -> derivative at the nodes [1/m].

        The derivative at a node is the volume-weighted mean of the derivatives in the cells around it.
        """
        corners = self.dim + 1
        rows = np.repeat(self.cells, corners, axis=1).ravel()  # node that receives
        columns = np.tile(self.cells, (1, corners)).ravel()  # node whose value enters
        around = scatter_sum(self.cells, np.repeat(self.cell_volumes, corners), self.n_nodes)
        weights = self.cell_volumes[:, None, None] / around[self.cells][:, :, None]
        shape = (self.n_nodes, self.n_nodes)
        return tuple(
            sp.csr_matrix(
                ((weights * self.cell_gradients[:, None, :, axis]).ravel(), (rows, columns)), shape=shape
            )
            for axis in range(self.dim)
        )

    def deformation_gradients(self, positions: Array, cells: IntArray | slice = slice(None)) -> Array:
        """F (n, dim, dim) of the given cells with the nodes at positions (n_nodes, dim)."""
        corners = positions[self.cells[cells]]
        return corners.transpose(0, 2, 1) @ self.cell_gradients[cells]


def signed_volumes(points: Array, cells: IntArray) -> Array:
    """(n_cells,) volume of each cell, negative for inverted corners."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    return np.linalg.det(edges) / factorial(points.shape[1])


def facet_vectors(points: Array, facets: IntArray) -> Array:
    """(n_facets, dim) normal times measure of oriented edges (2D) or triangles (3D)."""
    along = points[facets[:, 1]] - points[facets[:, 0]]
    if points.shape[1] == 2:
        return np.column_stack([along[:, 1], -along[:, 0]])
    return 0.5 * np.cross(along, points[facets[:, 2]] - points[facets[:, 0]])


def node_normals(points: Array, facets: IntArray) -> Array:
    """(n_points, dim) sums over the facets around each point of their normals times their length [m] or area [m^2]."""
    sums, vectors = np.zeros_like(points), facet_vectors(points, facets)
    for corner in facets.T:
        np.add.at(sums, corner, vectors)
    return sums
