"""W_elastic of a statically condensed body, x = U rows + u (`static_condensation.py`), on the cubature cells.

Elastic energy is invariant under rotations, so the energy of a cell is evaluated in the frame of the cell, with
rotation R_c (`corotation.py`). There the deformation gradient is affine in the strain d = R_c^T rows - rest and in
gravity R_c^T g,

    F_c = R_c (I + B_c z),    z = (d, R_c^T g),    E = sum_c w_c Psi(F_c) + cubature residual,

with B_c constant. With the last term (`cubature_residual.py`) the cubature integrates only the nonlinear part; without
it the modes L, less smooth than U, would need twice the cells. The error of the forces on the handles in the internal
equilibria of full space is 22 % on the Hand, whose fingers bend by right angles, 1.0 % on the Finger, 20 % on the Ball
and 0.3 % on the Jelly (RMS, motions of the report); with one rotation for the whole body 657 %, 0.7 %, 24 % and 0.1 %,
with U rows alone 193 %, 139 %, 176 % and 28 %, however fine the cubature.

With the rotations fixed, F is affine in the rows: B, with the near frames of every cell only (`handle_sparsity.py`), is
rotated to the world frame once per step, and then

    gradient = sum_c w_c B^T P + residual,    Hessian = sum_c w_c B^T A B + residual.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, RowHessian, known_hessian
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.handle_sparsity import HandleSparsity
from softprint.runtime.compiled import summing
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.cell_group_blocks import CellGroupBlocks
from softprint.runtime.dynamics.terms.corner_gradients import CornerGradients
from softprint.runtime.dynamics.terms.cubature_residual import CubatureResidual, Expansion
from softprint.runtime.dynamics.terms.elastic import watched_elasticity
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.corotation import Corotation
from softprint.runtime.mechanics.static_condensation import StaticCondensation


class CondensedElasticEnergy:
    """The energy at U rows, static condensation and the corrections; an `Elastic`."""

    def __init__(self, body: ReducedBody, points: CorrectedPoints, condensation: StaticCondensation) -> None:
        """condensation: of all nodes of the body."""
        self.points, self.condensation = points, condensation
        self.elasticity = watched_elasticity(body, points)
        self.corners = CornerGradients(self.elasticity, points)
        cells = body.mesh.cells[body.cubature.cells]
        gradients = condensation.rotation_gradients[cells].mean(axis=1)
        self._corotation = Corotation(gradients, condensation.affine_part)
        by_strain, by_gravity = _derivatives(self.elasticity, condensation.at(cells.ravel()))
        groups, by_strain = HandleSparsity(body).groups(by_strain)
        # Rounded to float32 before its first use, so that all quantities derived from it are consistent.
        by_strain = by_strain.astype(np.float32).astype(np.float64)
        self.blocks = CellGroupBlocks(groups, body.n_rows, body.dim)
        self._by_strain = self.blocks.packed(by_strain).astype(np.float32)
        rest = by_strain @ condensation.centred_rest_rows.ravel()
        self._unstrained = np.eye(body.dim) - rest.reshape(-1, body.dim, body.dim)
        self._by_gravity = by_gravity
        by_unknowns = np.concatenate([by_strain, by_gravity], axis=2)
        self._residual = CubatureResidual(body, condensation, self.elasticity, by_unknowns)

    @property
    def products(self) -> int:
        """See `Elastic`."""
        return self.blocks.products

    def in_frame(self, frame_rows: Array) -> CorotatedElasticity:
        """See `Elastic`."""
        own, rotations = self.condensation, self._corotation.rotations(frame_rows)
        B = self.blocks.to_world(self._by_strain, rotations)
        seen = self._unstrained + self.blocks.seen(self._by_strain, rotations, own.centred(frame_rows))
        F = _in_world(rotations, seen, self._by_gravity, own.gravity)
        return CorotatedElasticity(self, frame_rows, F, B, self._residual.about(frame_rows))


@dataclass(frozen=True, eq=False)
class CorotatedElasticity:
    """An `ElasticInFrame`. F: (m, dim, dim) of the cells at the frame rows (n_rows, dim); B: dF/drows in the world
    frame (`CellGroupBlocks`), in single precision, since it is read several times per step and multiplied by small
    changes; residual: the cubature residual."""

    term: CondensedElasticEnergy
    frame_rows: Array
    F: Array
    B: NDArray[np.float32]
    residual: Expansion

    @lazy
    def dense(self) -> NDArray[np.float32]:
        """B (m*dim*dim, n_rows*dim)."""
        return self.term.blocks.dense(self.B).astype(np.float32, copy=False)

    def basis_along(self, directions: Array | None) -> NDArray[np.float32]:
        """See `ElasticInFrame`."""
        return self.dense if directions is None else self.dense @ directions.astype(np.float32)

    def evaluate(self, rows: Array, displacement: Array | None) -> StrainedCells:
        """See `ElasticInFrame`."""
        term, residual, F = self.term, self.residual, self.F
        change = term.condensation.centred(rows - self.frame_rows).ravel()
        # A step starts at the frame rows, with no change.
        if change.any():
            F = F + term.blocks.times(self.B, change)
        if displacement is not None:
            F = F + term.elasticity.correction_gradients(displacement)
        pull = residual.stiffness @ change
        beyond_cubature = residual.value + float(change @ (residual.slope + 0.5 * pull))
        density, stress = term.elasticity.material.energy_and_stress(F)
        weights = term.elasticity.weights
        stress *= weights[:, None, None]
        energy = beyond_cubature + float(weights @ density)
        return StrainedCells(self, F, energy, stress, residual.slope + pull)


@dataclass(frozen=True, eq=False)
class StrainedCells:
    """An `ElasticEvaluation`: F of the cells, E [J], their stress w P (m, dim, dim), and the gradient of the cubature
    residual (n_rows*dim,) [N]."""

    frame: CorotatedElasticity
    F: Array
    energy: float
    stress: Array
    residual_force: Array

    def linearise(self, field: CorrectionField | None) -> tuple[Array, RowHessian]:
        """See `ElasticEvaluation`."""
        term, B, stress = self.frame.term, self.frame.B, self.stress
        shape = self.frame.frame_rows.shape
        gradient = (self.residual_force + term.blocks.gathered(B, stress)).reshape(shape)
        of_cells: RowHessian = self._cell_stiffness
        if field is not None:
            forces = term.corners.forces(stress, field)
            gradient = gradient + field.pulled_back(forces)
            of_cells = partial(self._corrected_stiffness, field, forces)
        residual = known_hessian(self.frame.residual.stiffness)
        return gradient, lambda along=None: of_cells(along) + residual(along)

    def _corrected_stiffness(
        self, field: CorrectionField, forces: Array, along: Array | None = None
    ) -> Array:
        """The Hessian of the cells with a field correction, whose forces at its points are given."""
        B = self.frame.basis_along(along)
        return self.frame.term.corners.hessian(self.F, B, field, forces, along)

    def _cell_stiffness(self, along: Array | None = None) -> Array:
        """sum_c w_c B^T A B."""
        elasticity = self.frame.term.elasticity
        tangent = elasticity.material.tangent(self.F)
        tangent *= elasticity.weights[:, None, None, None, None]
        return self.frame.term.blocks.stiffness(self.frame.B, tangent, along)


@summing
def _in_world(rotations: Array, seen: Array, by_gravity: Array, gravity: Array) -> Array:
    """F = R (seen + B_g R^T g) (m, dim, dim); seen: I + B d (m, dim, dim) in the frames of the cells; by_gravity: B_g
    (m, dim*dim, dim)."""
    m, dim, _ = rotations.shape
    F, own = np.zeros((m, dim, dim)), np.empty(dim)
    for c in range(m):
        R = rotations[c]
        for b in range(dim):
            own[b] = 0.0
            for a in range(dim):
                own[b] += gravity[a] * R[a, b]
        for i in range(dim):
            for j in range(dim):
                entry = seen[c, i, j]
                for b in range(dim):
                    entry += by_gravity[c, i * dim + j, b] * own[b]
                for a in range(dim):
                    F[c, a, j] += R[a, i] * entry
    return F


def _derivatives(elasticity: ReducedElasticity, corners: StaticCondensation) -> tuple[Array, Array]:
    """dF/dd (m, dim*dim, n_rows*dim) and dF/d(R^T g) (m, dim*dim, dim) over (cell, i, j), without rotation; corners:
    the condensation at the corners of the cells."""
    gradients = elasticity.hat_gradients
    m, n_corners, dim = gradients.shape

    def of_corners(values: NDArray[Any]) -> Array:
        by_corner = values.reshape(m, n_corners, dim, -1).astype(np.float64)
        return np.einsum("caj,caiz->cijz", gradients, by_corner, optimize=True).reshape(m, dim * dim, -1)

    rows = elasticity.basis_derivative().reshape(m, dim * dim, -1) + of_corners(corners.unrotated_jacobian())
    return rows, of_corners(corners.weight)
