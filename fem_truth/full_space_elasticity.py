"""The elastic energy of a whole body in DOLFINx: value, gradient and Hessian from one UFL form (P1, one
point).

    W(x) = sum over cells of volume * psi(F),   F = I + grad u,   u = x - X.

Node order is always that of `body.mesh`; DOLFINx's own numbering never leaves this module.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem

from fem_truth import dolfinx_version as dfx
from fem_truth.block_matrix import BlockMatrix, BlockPattern
from fem_truth.elasticity_form import energy_density
from runtime.arrays import Array, IntArray
from runtime.elasticity.determinant import determinant
from runtime.elasticity.materials import Material
from runtime.mesh import Mesh


class ElasticBody(Protocol):
    """What elasticity needs of a body: a mesh, and a material with one value for all cells or one for each."""

    @property
    def mesh(self) -> Mesh: ...
    @property
    def material(self) -> Material: ...


class FullSpaceElasticity:
    """W(x) [J] and its derivatives at node positions x (n_nodes, dim) [m]; the matrix is reused between
    calls."""

    def __init__(self, body: ElasticBody) -> None:
        mesh, material = body.mesh, body.material
        self.mesh: Mesh = mesh
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
        self._pattern, self._block_order = self._node_ordered_pattern()
        #: Energy of a strain of one everywhere [J] and the matching force [N]: the scales of "nothing at
        #: all".
        self.unit_energy = float(mesh.cell_volumes @ (2 * mu_values + np.abs(lam_values)))
        self.unit_force = self.unit_energy / mesh.size

    @property
    def pattern(self) -> BlockPattern:
        return self._pattern

    def energy(self, x: Array) -> float:
        """W(x) [J]; not finite where the material has no energy (neo-Hookean, inverted)."""
        self._set(x)
        return dfx.assemble_scalar(self._energy)

    def gradient(self, x: Array) -> Array:
        """dW/dx (n_nodes, dim) [N]."""
        self._set(x)
        gradient = np.empty_like(self.mesh.points)
        gradient[self._node_of_dof] = self._gradient().reshape(-1, self.mesh.dim)
        return gradient

    def hessian(self, x: Array) -> BlockMatrix:
        """d2W/dx2 as blocks [N/m], assembled by DOLFINx into BAIJ and handed over in node order."""
        self._set(x)
        self._hessian.assemble()
        blocks = np.take(
            self._hessian.blocks(), self._block_order, axis=0
        )  # C order: scipy copies anything else
        return BlockMatrix(self._pattern, blocks)

    def deformation_gradients(self, x: Array) -> Array:
        """F (n_cells, dim, dim)."""
        return self.mesh.deformation_gradients(x)

    def min_det_F(self, x: Array) -> float:
        """The smallest volume ratio of a cell: not positive if a cell is inverted."""
        return float(determinant(self.deformation_gradients(x)).min())

    def _set(self, x: Array) -> None:
        self._u.x.array[:] = (x - self.mesh.points)[self._node_of_dof].ravel()

    def _node_ordered_pattern(self) -> tuple[BlockPattern, IntArray]:
        """The pattern in the mesh's node order, and for each of its blocks where it lies among DOLFINx's."""
        starts, columns = self._hessian.row_starts, self._hessian.columns
        n = self.mesh.n_nodes
        rows = np.repeat(self._node_of_dof, np.diff(starts))
        # One more than the position, for scipy drops explicit zeros in some conversions.
        positions = np.arange(1, len(columns) + 1, dtype=np.int64)
        ordered = sp.csr_matrix((positions, (rows, self._node_of_dof[columns])), shape=(n, n))
        ordered.sort_indices()
        return BlockPattern.from_csr(ordered.indptr, ordered.indices), ordered.data - 1
