"""The elastic energy of a simplex mesh: one deformation gradient a cell, exact for P1 elements.

E = sum_c V_c Psi(F_c),  F_c = x_c^T G_c,  with the cells' corners x_c (dim+1, dim) and hat gradients G_c.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, scatter_sum
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.mesh import Mesh


def elastic_energy(mesh: Mesh, material: Material, positions: Array) -> float:
    """E [J] (per metre of thickness in 2D) of the mesh with its nodes at positions (n_nodes, dim)."""
    return float(mesh.cell_volumes @ material.energy_density(mesh.deformation_gradients(positions)))


def elastic_gradient(mesh: Mesh, material: Material, positions: Array) -> Array:
    """dE/dx (n_nodes, dim) [N]; elastic forces are its negative."""
    stress = material.first_piola(mesh.deformation_gradients(positions))
    blocks = element_gradients(stress, mesh.cell_gradients, mesh.cell_volumes)
    return np.stack(
        [scatter_sum(mesh.cells, blocks[:, :, axis], mesh.n_nodes) for axis in range(mesh.dim)],
        axis=1,
    )


def element_gradients(stress: Array, gradients: Array, volumes: Array) -> Array:
    """V sum_j G_aj P_ij: (n, dim+1, dim) [N], the gradient at the corners of each cell."""
    return volumes[:, None, None] * (gradients @ stress.transpose(0, 2, 1))


def element_hessians(tangent: Array, gradients: Array, volumes: Array) -> Array:
    """V sum_jl G_aj A_ijkl G_bl: (n, (dim+1)*dim, (dim+1)*dim) [N/m], row-major in (corner, axis)."""
    count, corners, dim = gradients.shape
    right = tangent.reshape(count, dim**3, dim) @ gradients.transpose(0, 2, 1)  # (n, ijk, b)
    right = (
        right.reshape(count, dim, dim, dim * corners).transpose(0, 2, 1, 3).reshape(count, dim, -1)
    )  # (n, j, ikb)
    both = (gradients @ right).reshape(count, corners, dim, dim, corners)  # (n, a, i, k, b)
    blocks = both.transpose(0, 1, 2, 4, 3).reshape(count, corners * dim, corners * dim)
    return volumes[:, None, None] * blocks
