"""The elastic energy of a whole body of P1 simplices: value, gradient and Hessian.

    W(x) = sum over cells of volume * psi(F),   F = sum over corners a of x_a g_a^T,   g_a = gradient of hat a.

Materials that have a compiled kernel are evaluated by it (`native_elasticity.py`), all others from their UFL form by
DOLFINx (`form_elasticity.py`).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from softprint.fem_truth.elasticity.form_elasticity import FormElasticity
from softprint.fem_truth.elasticity.native_elasticity import KERNELS, NativeElasticity
from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.fem_truth.native.memory import keep_freed_memory
from softprint.fem_truth.parts.body_part import BodyPart
from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.mesh import Mesh


class ElasticBody(Protocol):
    """What elasticity needs from a body: a mesh, and a material with one value for all cells or one per cell."""

    @property
    def mesh(self) -> Mesh: ...
    @property
    def material(self) -> Material: ...


class FullSpaceElasticity:
    """W(x) [J] and its derivatives at node positions x (n_nodes, dim) [m], in the node order of `body.mesh`.

    forms: use the UFL form even if there is a compiled kernel; both agree to round-off. part: the cells and nodes of
    the body on this rank, if the body is partitioned over ranks; x are then the positions of these nodes, and the
    results are the rank's shares (`fem_truth.parts.share`).
    """

    def __init__(self, body: ElasticBody, forms: bool = False, part: BodyPart | None = None) -> None:
        keep_freed_memory()
        self.part = part
        on_this_rank: ElasticBody = body if part is None else part
        mesh, material = on_this_rank.mesh, on_this_rank.material
        self.mesh: Mesh = mesh
        law = NativeElasticity if material.model in KERNELS and not forms else FormElasticity
        self._law: NativeElasticity | FormElasticity = law(mesh, material)
        moduli = 2 * np.broadcast_to(body.material.mu, body.mesh.n_cells) + np.abs(body.material.lam)
        #: Energy of a strain of one everywhere in the body [J] and the matching force [N]: energies and forces that are
        #: tiny relative to these count as zero.
        self.unit_energy = float(body.mesh.cell_volumes @ moduli)
        self.unit_force = self.unit_energy / body.mesh.size

    def energy(self, x: Array) -> float:
        """W(x) [J]; not finite where the energy is undefined (neo-Hookean with inverted cells)."""
        return self._law.energy(x)

    def gradient(self, x: Array) -> Array:
        """dW/dx (n_nodes, dim) [N]."""
        return self._law.energy_gradient(x)[1]

    def energy_gradient(self, x: Array) -> tuple[float, Array]:
        """Both at once, at hardly more cost than one of them."""
        return self._law.energy_gradient(x)

    def hessian(self, x: Array) -> BlockMatrix:
        """d2W/dx2 as blocks [N/m]."""
        return self._law.hessian(x)

    def deformation_gradients(self, x: Array) -> Array:
        """F (n_cells, dim, dim)."""
        return self.mesh.deformation_gradients(x)

    def min_det_F(self, x: Array) -> float:
        """The smallest volume ratio of a cell: not positive if a cell is inverted."""
        return self._law.min_det_F(x)
