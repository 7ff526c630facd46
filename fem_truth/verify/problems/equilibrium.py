"""Static equilibria of plain bodies (no handles, no subspace) with Softprint's own elasticity and minimiser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.potentials import Potential
from softprint.fem_truth.energy.total_energy import Gradient, TotalEnergy
from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.statics.newton import FullSpaceSettings, minimise
from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh
from softprint.runtime.optimise import NewtonSettings


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh and its material."""

    mesh: Mesh
    material: Material


@dataclass(frozen=True, eq=False)
class DeadLoad(Potential):
    """W = - sum_i f_i . (x_i - X_i): constant forces, independent of the deformation. force: f (n_nodes, dim) [N]."""

    force: Array
    rest: Array

    def energy(self, x: Array) -> float:
        return -float(np.vdot(self.force, x - self.rest))

    def gradient(self, x: Array) -> Array:
        return -self.force

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        """Nothing: the energy is linear in x."""


class HeldComponents(NullSpace):
    """Displacements that are zero in fixed components: rollers and planes of symmetry. held: (n_nodes, dim) mask."""

    def __init__(self, held: BoolArray) -> None:
        super().__init__(np.zeros((len(held), 0)), np.flatnonzero(held.all(axis=1)))
        self._moving = np.where(held, 0.0, 1.0)

    def project(self, v: Array) -> Array:
        return v * self._moving

    def moving(self, dim: int) -> Array:
        return self._moving

    def violation(self, v: Array) -> float:
        return float(np.abs(v * (1.0 - self._moving)).max(initial=0.0))


class _LoadedEnergy(TotalEnergy):
    """Force scale: the elastic forces including reactions; energy scale: the elastic energy.

    The force scale is at least 1e-4 of the forces at a strain of one, because smaller ones are sums of terms that
    cancel.
    """

    elastic: FullSpaceElasticity

    def force_scale(self, x: Array, gradient: Gradient) -> float:
        return max(float(np.linalg.norm(gradient.elastic)), 1e-4 * self.elastic.unit_force)

    def energy_scale(self, x: Array) -> float:
        return max(self.elastic.energy(x), 1e-18 * self.elastic.unit_energy)


def equilibrium(
    elasticity: FullSpaceElasticity,
    held: BoolArray,
    start: Array,
    terms: Sequence[Potential] = (),
    tolerance: float = 1e-10,
) -> Array:
    """Equilibrium positions (n_nodes, dim), started from `start`, whose fixed components do not change.

    held: (n_nodes, dim) mask of fixed components; tolerance: of the residual, relative to the elastic forces. Raises
    SoftprintError if the minimiser does not reach it.
    """
    problem = _LoadedEnergy(elasticity, terms, HeldComponents(held))
    settings = FullSpaceSettings(
        NewtonSettings(max_iterations=100, tolerance=tolerance),
        decrement_tolerance=1e-12,
        cg_tolerance_min=1e-5,
        cg_max_iterations=20000,
    )
    result = minimise(problem, start, settings)
    if not result.converged:
        raise SoftprintError(
            f"no equilibrium was found (residual {result.residual:.1e}): {result.status.sentence}"
        )
    return result.x


def mean_first_piola(mesh: Mesh, force: Array) -> Array:
    """The mean of P over the body (dim, dim) [Pa] from the forces on its nodes, W'(x) (n_nodes, dim) [N].

    integral P dV = sum_i f_i (x) X_i in equilibrium, by the divergence theorem.
    """
    return force.T @ mesh.points / float(mesh.cell_volumes.sum())
