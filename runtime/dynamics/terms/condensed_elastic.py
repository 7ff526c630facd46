"""W_elastic of the body in its internal equilibrium, x = U rows + u_int (`static_condensation.py`), on the cubature.

Elastic energy does not change with a rotation, so that of a cell is best seen from the cell, which has turned by R_c
(`corotation.py`). There the deformation gradient is affine in the strain d = R_c^T rows - rest and in gravity R_c^T g,

    F_c = R_c (I + B_c z),    z = (d, R_c^T g),    E = sum_c w_c Psi(F_c) + what the cubature misses at rest,

with B_c constant. The last term (`cubature_residual.py`) leaves to the cubature only what is not linear; without it the
modes L, rougher than U, would need twice the cells. Of the forces on the handles in the internal equilibria of full
space this misses 22 % on the Hand, whose fingers bend by right angles, 1.0 % on the Finger, 20 % on the Ball and 0.3 %
on the Jelly (RMS, motions of the report); with one turn for the whole body 657 %, 0.7 %, 24 % and 0.1 %, with U rows
alone 193 %, 139 %, 176 % and 28 %, however fine the cubature.

With the turn held, F is affine in the rows: once in a step B, of the frames that a cell feels
(`handle_sparsity.py`), is turned to the world, and then

    gradient = sum_c w_c B^T P + missed,    Hessian = sum_c w_c B^T A B + missed.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, RowHessian, known_hessian, same
from runtime.body.body import ReducedBody
from runtime.body.handle_sparsity import HandleSparsity
from runtime.compiled import summing
from runtime.dynamics.corrected_points import CorrectedPoints
from runtime.dynamics.terms.cell_group_blocks import CellGroupBlocks
from runtime.dynamics.terms.cubature_residual import CubatureResidual, Expansion
from runtime.dynamics.terms.elastic import watched_elasticity, with_field
from runtime.elasticity.reduced_elasticity import ReducedElasticity
from runtime.learned.correction import CorrectionField
from runtime.mechanics.corotation import Corotation
from runtime.mechanics.static_condensation import StaticCondensation


class _Held(NamedTuple):
    """A turn, F of the cells there, dF/drows in world frame (`CellGroupBlocks`), and what the cubature misses."""

    turn: Array
    F: Array
    # In single precision: it is read several times in a step, and what it is multiplied by is small.
    B: NDArray[np.float32]
    missed: Expansion


class _Strained(NamedTuple):
    """A body at handle rows and turn: F of the cells, E [J], the stress w P of the cells, and the slope of what the
    cubature misses (n_rows*dim,)."""

    rows: Array
    turn: Array
    F: Array
    energy: float
    stress: Array
    missed: Array

    def is_at(self, rows: Array, turn: Array) -> bool:
        return same(self.rows, rows) and same(self.turn, turn)


class CondensedElasticEnergy:
    """Of U rows, the internal response and the corrections at the watched points; an `Elastic`."""

    def __init__(self, body: ReducedBody, points: CorrectedPoints, internal: StaticCondensation) -> None:
        """internal: of all nodes of the body."""
        self._points, self._internal = points, internal
        self._elasticity = watched_elasticity(body, points)
        cells = body.mesh.cells[body.cubature.cells]
        self._turning = Corotation(internal.turning[cells].mean(axis=1), internal.positions)
        by_strain, by_gravity = _derivatives(self._elasticity, internal.at(cells.ravel()))
        groups, by_strain = HandleSparsity(body).groups(by_strain)
        # Rounded before anything is made of it, so that all agree.
        by_strain = by_strain.astype(np.float32).astype(np.float64)
        self._blocks = CellGroupBlocks(groups, body.n_rows, body.dim)
        self._by_strain = self._blocks.packed(by_strain).astype(np.float32)
        rest = by_strain @ internal.at_rest.ravel()
        self._unstrained = np.eye(body.dim) - rest.reshape(-1, body.dim, body.dim)
        self._by_gravity = by_gravity
        by_unknowns = np.concatenate([by_strain, by_gravity], axis=2)
        self._missed = CubatureResidual(body, internal, self._elasticity, by_unknowns)
        self._held: _Held | None = None
        self._last: _Strained | None = None

    def energy(self, rows: Array, turn: Array, displacement: Array | None) -> float:
        """See `Elastic`."""
        return self._strained(rows, turn, displacement).energy

    def linearise(
        self, rows: Array, turn: Array, field: CorrectionField | None
    ) -> tuple[float, Array, RowHessian]:
        """See `Elastic`."""
        held, elasticity = self._at(turn), self._elasticity
        missed = held.missed
        at = self._strained(rows, turn, self._points.scatter(field))
        stress = at.stress
        of_cells: RowHessian
        if field is None:
            slope = at.missed + self._blocks.gathered(held.B, stress)
            of_cells = partial(self._stiffness, held, at.F)
        else:
            shape = *at.F.shape, *rows.shape
            B = with_field(self._blocks.dense(held.B).reshape(shape), elasticity, self._points, field)
            slope = at.missed + stress.ravel() @ B.reshape(stress.size, -1)
            of_cells = known_hessian(elasticity.general_hessian(at.F, B))

        def hessian(along: Array | None = None) -> Array:
            return of_cells(along) + known_hessian(missed.stiffness)(along)

        return at.energy, slope.reshape(rows.shape), hessian

    @property
    def products(self) -> int:
        """Multiplications that the Hessian takes."""
        return self._blocks.products

    def _stiffness(self, held: _Held, F: Array, along: Array | None = None) -> Array:
        """sum_c w_c B^T A B."""
        tangent = self._elasticity.material.tangent(F)
        tangent *= self._elasticity.weights[:, None, None, None, None]
        return self._blocks.stiffness(held.B, tangent, along)

    def _at(self, turn: Array) -> _Held:
        """The last one is kept."""
        if self._held is None or not same(self._held.turn, turn):
            internal, rotations = self._internal, self._turning.rotations(turn)
            B = self._blocks.to_world(self._by_strain, rotations)
            stretched = self._blocks.seen(self._by_strain, rotations, internal.centred(turn))
            seen = self._unstrained + stretched
            F = _in_world(rotations, seen, self._by_gravity, internal.gravity)
            self._held = _Held(turn.copy(), F, B, self._missed.about(turn))
        return self._held

    def _strained(self, rows: Array, turn: Array, displacement: Array | None) -> _Strained:
        """At handle rows, and displacements (n, dim) of the watched points. Without these the last one is kept: a line
        search ends where the next iteration begins."""
        last = self._last
        if displacement is None and last is not None and last.is_at(rows, turn):
            return last
        held = self._at(turn)
        missed = held.missed
        change = self._internal.centred(rows - turn).ravel()
        # A step begins where the turn is taken.
        F = held.F + self._blocks.times(held.B, change) if change.any() else held.F
        if displacement is not None:
            F = F + self._elasticity.correction_gradients(displacement)
        elasticity, pull = self._elasticity, missed.stiffness @ change
        energy = missed.value + float(change @ (missed.slope + 0.5 * pull))
        density, stress = elasticity.material.energy_and_stress(F)
        stress *= elasticity.weights[:, None, None]
        energy += float(elasticity.weights @ density)
        found = _Strained(rows.copy(), turn.copy(), F, energy, stress, missed.slope + pull)
        if displacement is None:
            self._last = found
        return found


@summing
def _in_world(rotations: Array, seen: Array, by_gravity: Array, gravity: Array) -> Array:
    """F = R (seen + B_g R^T g) (m, dim, dim), B_g (m, dim*dim, dim)."""
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
    """dF/dd (m, dim*dim, n_rows*dim) and dF/d(R^T g) (m, dim*dim, dim) over (cell, i, j), unturned; corners: the
    response at the corners of the cells."""
    gradients = elasticity.hat_gradients
    m, n_corners, dim = gradients.shape

    def of_corners(values: NDArray[Any]) -> Array:
        by_corner = values.reshape(m, n_corners, dim, -1).astype(np.float64)
        return np.einsum("caj,caiz->cijz", gradients, by_corner, optimize=True).reshape(m, dim * dim, -1)

    rows = elasticity.basis_derivative().reshape(m, dim * dim, -1) + of_corners(corners.unturned())
    return rows, of_corners(corners.weight)
