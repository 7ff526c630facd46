"""A cubature of a corrected body, learned from its training states (An, Kim and James 2008).

The cubature of a body is fitted to the gradients of its basis, without any state, and what a correction adds varies
faster than these. Here the weights of cells are fitted to the forces and energies of the corrected states themselves.
With the generalised forces g_cs of cell c in state s for each unit of volume, in units of the handles (`dof_scale`),
and energies psi_cs,

    sum_c w_c g_cs = g_s,    sum_c w_c psi_cs = E_s,    g_s, E_s: over all cells,

each divided by |g_s| or E_s, in the least-squares sense, with w >= 0 and a weak pull towards the weights that the same
cells have in the cubature of the body.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.cubature import Cubature, choose_cubature, dof_scale, elastic_cells
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.condensed_elastic import CondensedElasticEnergy
from softprint.runtime.dynamics.terms.elastic import ElasticEnergy
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.learned.internal.file import with_cubature
from softprint.runtime.mechanics.static_condensation import StaticCondensation

# Pull towards the weights of the body's cubature, relative to the forces: from 0.003 to 0.03 the error hardly changes.
_PULL = 0.01
# States that weights are fitted to: with 30 coordinates they are more equations than there are cells.
_STATES = 100


class ForceSystem(NamedTuple):
    """forces: (s, k, m) and energies (s, m) of the cells (m,) in every state, for each unit of volume, divided by the
    size of those of the whole body; whole: (s, k) forces of the whole body, of unit length. Energies of the whole body
    are 1."""

    cells: IntArray
    forces: Array
    energies: Array
    whole: Array

    def errors(self, cells: IntArray, weights: Array) -> tuple[float, float]:
        """(force, energy) of a cubature, relative: RMS over the states, and mean."""
        at = np.searchsorted(self.cells, cells)
        missed = self.forces[:, :, at] @ weights - self.whole
        energy = np.abs(self.energies[:, at] @ weights - 1.0)
        return float(np.sqrt(np.square(missed).sum(axis=1).mean())), float(energy.mean())


def force_system(
    body: ReducedBody, internal: InternalField, condensation: StaticCondensation | None, states: Array
) -> ForceSystem:
    """Of all cells that can deform, in states (s, n_rows, dim) of the corrected body."""
    cells = elastic_cells(body.mesh, body.handles)
    volumes = body.mesh.cell_volumes[cells]
    whole_body = with_cubature(body, Cubature(cells, volumes, 0.0, 0.0))
    points, phase = CorrectedPoints(whole_body, [], internal=internal, surface=False), Timings().correction
    term = (
        ElasticEnergy(whole_body, points)
        if condensation is None
        else CondensedElasticEnergy(whole_body, points, condensation)
    )
    scale, material = dof_scale(body.mesh, body.handles), term.elasticity.material
    forces, energies, whole = [], [], []
    for rows in states:
        field = points.linearise(rows, {}, phase)
        assert field is not None  # there is a correction
        tangent = body.handles.tangent(rows) * scale
        frame = term.in_frame(rows)
        F, basis = frame.evaluate(rows, field.displacement).F, frame.basis_along(tangent)
        B = term.corners.corrected(basis, field, tangent)
        of_cells = np.einsum("cp,cpk->kc", material.first_piola(F).reshape(len(cells), -1), B)
        energy, total = material.energy_density(F), of_cells @ volumes
        forces.append(of_cells / np.linalg.norm(total))
        energies.append(energy / (energy @ volumes))
        whole.append(total / np.linalg.norm(total))
    return ForceSystem(cells, np.array(forces), np.array(energies), np.array(whole))


def learned_cubature(body: ReducedBody, system: ForceSystem, count: int) -> tuple[IntArray, Array]:
    """At most `count` cells (m,) and their weights (m,) [m^dim]: the cells of `choose_cubature`, without those that get
    no weight."""
    cells, usual = choose_cubature(body.mesh, body.basis, body.handles, body.material, count)
    at, (n, k, _) = np.searchsorted(system.cells, cells), system.forces.shape
    rows = np.concatenate([system.forces[:, :, at].reshape(n * k, -1), system.energies[:, at]]) * usual
    target = np.concatenate([system.whole.ravel(), np.ones(n)])
    pull = _PULL**2 / len(cells)
    gram = rows.T @ rows / n + pull * np.eye(len(cells))
    lower = np.linalg.cholesky(gram)
    share, _ = nnls(lower.T, np.linalg.solve(lower, rows.T @ target / n + pull), maxiter=50 * len(cells))
    kept = share > 0.0
    return cells[kept], (share * usual)[kept]


def fitted_cubature(
    body: ReducedBody,
    internal: InternalField,
    condensation: StaticCondensation | None,
    train: Array,
    held_out: Array,
    count: int,
    rng: np.random.Generator,
) -> tuple[Cubature, tuple[float, float]]:
    """The cubature learned from some of the training states (s, n_rows, dim), with its errors in held-out ones; and the
    (energy, force) errors there of the body's own cubature."""

    def some(states: Array) -> ForceSystem:
        return force_system(body, internal, condensation, rng.permutation(states)[:_STATES])

    cells, weights = learned_cubature(body, some(train), count)
    judge = some(held_out)
    force, energy = judge.errors(cells, weights)
    before = judge.errors(body.cubature.cells, body.cubature.weights)
    return Cubature(cells, weights, energy, force), (before[1], before[0])
