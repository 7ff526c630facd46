"""The elastic energy of a whole body from its UFL form, assembled by DOLFINx (P1, one quadrature point): for every
material, and as the reference for the compiled kernels.

Node order is always that of the mesh; DOLFINx's numbering is used inside this module only.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem

from softprint.fem_truth.elasticity import dolfinx_version as dfx
from softprint.fem_truth.elasticity.energy_densities import energy_density
from softprint.fem_truth.linalg.block_matrix import BlockMatrix, BlockPattern, UpperBlocks
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.elasticity.invariants import determinant
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.mesh import Mesh


class FormElasticity:
    """W(x) [J] and its derivatives at node positions x (n_nodes, dim) [m]."""

    def __init__(self, mesh: Mesh, material: Material) -> None:
        self._mesh = mesh
        mu_values, lam_values = (np.broadcast_to(v, mesh.n_cells) for v in (material.mu, material.lam))
        with dfx.quiet_compiler():
            domain = dfx.make_mesh(mesh)
            space, cell_space = dfx.vector_space(domain, mesh.dim), dfx.cell_space(domain)
            self._node_of_dof, cell_of_dof = dfx.orderings(domain, space, cell_space, mesh)
            self._u = fem.Function(space)
            mu, lam = fem.Function(cell_space), fem.Function(cell_space)
            mu.x.array[:], lam.x.array[:] = mu_values[cell_of_dof], lam_values[cell_of_dof]

            F = ufl.Identity(mesh.dim) + ufl.grad(self._u)
            dx = ufl.dx(
                domain, metadata={"quadrature_degree": 1}
            )  # F is constant in a P1 cell: one point is exact
            energy = energy_density(material.model, F, mu, lam) * dx
            gradient = ufl.derivative(energy, self._u)
            self._energy = dfx.compile_form(energy)
            self._gradient = dfx.VectorAssembler(dfx.compile_form(gradient))
            self._hessian = dfx.BlockMatrixAssembler(dfx.compile_form(ufl.derivative(gradient, self._u)))
        self._pattern, self._above, self._diagonal = self._node_ordered_pattern()

    def energy(self, x: Array) -> float:
        """W(x) [J]; not finite where the energy is undefined (neo-Hookean with inverted cells)."""
        self._set(x)
        return dfx.assemble_scalar(self._energy)

    def min_det_F(self, x: Array) -> float:
        """The smallest volume ratio of a cell."""
        return float(determinant(self._mesh.deformation_gradients(x)).min())

    def energy_gradient(self, x: Array) -> tuple[float, Array]:
        """W [J] and dW/dx (n_nodes, dim) [N]."""
        self._set(x)
        gradient = np.empty_like(self._mesh.points)
        gradient[self._node_of_dof] = self._gradient().reshape(-1, self._mesh.dim)
        return dfx.assemble_scalar(self._energy), gradient

    def hessian(self, x: Array) -> BlockMatrix:
        """d2W/dx2 as blocks [N/m] in node order, assembled into a BAIJ matrix."""
        self._set(x)
        self._hessian.assemble()
        blocks = self._hessian.blocks()
        upper = np.zeros((len(self._above) + 1, *blocks.shape[1:]))
        np.take(blocks, self._above, axis=0, out=upper[:-1])
        return BlockMatrix(UpperBlocks(self._pattern, upper), np.ascontiguousarray(blocks[self._diagonal]))

    def _set(self, x: Array) -> None:
        self._u.x.array[:] = (x - self._mesh.points)[self._node_of_dof].ravel()

    def _node_ordered_pattern(self) -> tuple[BlockPattern, IntArray, IntArray]:
        """The pattern in the mesh's node order, and the indices of its blocks and of the diagonal blocks in DOLFINx's
        matrix."""
        starts, columns = self._hessian.row_starts, self._hessian.columns
        n = self._mesh.n_nodes
        rows = np.repeat(self._node_of_dof, np.diff(starts))
        # Position + 1, because scipy drops explicit zeros in some conversions.
        positions = np.arange(1, len(columns) + 1, dtype=np.int64)
        ordered = sp.csr_matrix((positions, (rows, self._node_of_dof[columns])), shape=(n, n))
        above = sp.triu(ordered, 1, format="csr")
        above.sort_indices()
        pattern = BlockPattern(above.indptr.astype(np.int32), above.indices.astype(np.int32))
        return pattern, above.data - 1, ordered.diagonal() - 1
