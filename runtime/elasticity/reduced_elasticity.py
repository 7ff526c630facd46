"""The elastic energy on the cubature cells of a reduced body, and its derivatives by the handle rows.

With the basis gradients D_c (n_rows, dim) of a cell, F_c,ij = sum_r rows_ri D_c,rj (thesis eq. 3.11), so

    dE/drows_ri           = sum_c w_c D_c,rj P_c,ij
    d2E/drows_ri drows_sk = sum_c w_c D_c,rj A_c,ijkl D_c,sl,

each computed as one matrix product over (cell, j). What a correction of the corners of cells adds is in
`runtime/dynamics/terms/corner_gradients.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.linalg.row_products import deformed
from softprint.runtime.mesh import Mesh


@dataclass(frozen=True, eq=False)
class ReducedElasticity:
    """m cubature cells of a body.

    weights: (m,) [m^dim]; material: at those cells; basis_gradient: D (m, n_rows, dim) [1/m]; corners: (m,
    dim+1) node indices and hat_gradients: (m, dim+1, dim) [1/m] of the cells, for corrections that displace
    their corners.
    """

    weights: Array
    material: Material
    basis_gradient: Array
    corners: IntArray
    hat_gradients: Array

    @classmethod
    def on_cells(
        cls, mesh: Mesh, basis: Array, material: Material, cells: IntArray, weights: Array
    ) -> ReducedElasticity:
        """On any cells with any weights; all cells with their volumes give full integration.

        basis: (n_nodes, n_rows); material: of all cells of the mesh.
        """
        corners, gradients = mesh.cells[cells], mesh.cell_gradients[cells]
        basis_gradient = basis[corners].transpose(0, 2, 1) @ gradients
        return cls(weights, material.at(cells), basis_gradient, corners, gradients)

    def take(self, which: IntArray | BoolArray | slice) -> ReducedElasticity:
        """Some of the cells."""
        return ReducedElasticity(
            self.weights[which],
            self.material.at(which),
            self.basis_gradient[which],
            self.corners[which],
            self.hat_gradients[which],
        )

    @property
    def n_cells(self) -> int:
        return len(self.weights)

    @cached_property
    def _flat(self) -> Array:
        """D as a matrix (m*dim, n_rows), with rows (cell, j)."""
        return np.ascontiguousarray(
            self.basis_gradient.transpose(0, 2, 1).reshape(-1, self.basis_gradient.shape[1])
        )

    @cached_property
    def _flat_weighted(self) -> Array:
        """D^T times the weights, as a matrix (n_rows, m*dim)."""
        return np.ascontiguousarray(
            (np.repeat(self.weights, self.basis_gradient.shape[2])[:, None] * self._flat).T
        )

    @cached_property
    def _basis_gradient_transposed(self) -> Array:
        """D^T of every cell (m, dim, n_rows)."""
        return np.ascontiguousarray(self.basis_gradient.transpose(0, 2, 1))

    def deformation_gradients(self, rows: Array) -> Array:
        """F (m, dim, dim) of the reduced positions."""
        return deformed(self._basis_gradient_transposed, rows)

    def correction_gradients(self, displacement: Array) -> Array:
        """The change of F (m, dim, dim) by a displacement (n_nodes, dim) of the nodes."""
        return displacement[self.corners].transpose(0, 2, 1) @ self.hat_gradients

    def energy(self, F: Array) -> float:
        """E [J] at deformation gradients F (m, dim, dim)."""
        return float(self.weights @ self.material.energy_density(F))

    def gradient(self, F: Array) -> Array:
        """dE/drows (n_rows, dim) [N] where F depends on the rows through the basis alone."""
        stress = self.material.first_piola(F)
        return self._flat_weighted @ stress.transpose(0, 2, 1).reshape(-1, stress.shape[1])

    def gradient_of(self, stress: Array) -> Array:
        """dE/drows (n_rows, dim) [N] through the basis alone, of a stress w P (m, dim, dim)."""
        return self._flat.T @ stress.transpose(0, 2, 1).reshape(-1, stress.shape[1])

    def hessian(self, F: Array) -> Array:
        """d2E/drows2 (n_rows*dim, n_rows*dim) [N/m], row-major in (row, axis), where F depends on the rows through the
        basis alone."""
        count, n_rows, dim = self.basis_gradient.shape
        # The blocks of axes i and k with k < i are the transposes of the others.
        i, k = np.triu_indices(dim)
        tangent = self.material.tangent(F).transpose(0, 2, 1, 3, 4)[:, :, i, k]  # (c, j, ik, l)
        right = tangent.reshape(count, -1, dim) @ self._basis_gradient_transposed
        upper = (self._flat_weighted @ right.reshape(count * dim, -1)).reshape(n_rows, len(i), n_rows)
        blocks = np.empty((n_rows, dim, n_rows, dim))
        blocks[:, i, :, k] = upper.transpose(1, 0, 2)
        blocks[:, k, :, i] = upper.transpose(1, 2, 0)
        return blocks.reshape(n_rows * dim, n_rows * dim)

    def basis_derivative(self) -> Array:
        """B (m, dim, dim, n_rows, dim) by the basis alone: dF_ij/drows_rk = D_rj delta_ik."""
        dim = self.basis_gradient.shape[2]
        return np.einsum("crj,ik->cijrk", self.basis_gradient, np.eye(dim))

    @cached_property
    def _flat_single(self) -> NDArray[np.float32]:
        return self._flat.astype(np.float32)

    def basis_along(self, directions: Array | None) -> NDArray[np.float32]:
        """B (m*dim*dim, k) along directions (n_rows*dim, k) of the rows, by default every row and axis; in single
        precision, for Hessians."""
        m, n_rows, dim = self.basis_gradient.shape
        along = np.eye(n_rows * dim) if directions is None else directions
        B = np.empty((m, dim, dim, along.shape[1]), dtype=np.float32)
        for axis in range(dim):
            of_axis = np.ascontiguousarray(along[axis::dim], dtype=np.float32)
            B[:, axis] = (self._flat_single @ of_axis).reshape(m, dim, -1)
        return B.reshape(m * dim * dim, -1)
