"""A cubature for modes in elastic equilibrium, learned from training states (An, Kim and James 2008).

It has to integrate what a step reads: the derivatives of the elastic energy E(q, a) by the handles and by the
amplitudes, whose zero is the equilibrium, and E itself. Its weights are fitted to these in training states, half of
them at their own amplitudes a and half at a part of these, where E_a is not zero: together they know E_aa. Forces by
the handles are in units of the handles (`dof_scale`) and relative to their size; E_a is measured by the error of the
displacement that it makes, with the stiffness of the modes at rest H,

    |dE_a|^2 = dE_a . H^-1 dE_a / 2 E.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.cubature import Cubature, choose_cubature, dof_scale, elastic_cells
from softprint.runtime.learned.internal.equilibrium.correction import EquilibriumCorrection
from softprint.runtime.learned.internal.equilibrium.elastic_amplitudes import ElasticAmplitudes
from softprint.runtime.learned.internal.file import with_cubature
from softprint.runtime.learned.internal.model import ModesModel
from softprint.surrogate.internal.cubature import ForceSystem, learned_cubature

# States that weights are fitted to and judged in, and the least part of their amplitudes.
_STATES, _PART = 60, 0.3


def modes_cubature(
    body: ReducedBody,
    model: ModesModel,
    train: Array,
    amplitudes: Array,
    held_out: Array,
    held_out_amplitudes: Array,
    count: int,
    rng: np.random.Generator,
) -> Cubature:
    """At most `count` cells, from training states (s, n_rows, dim) with amplitudes (s, K), with its errors in held-out
    ones."""
    every = elastic_cells(body.mesh, body.handles)
    whole = with_cubature(body, Cubature(every, body.mesh.cell_volumes[every], 0.0, 0.0))
    integrated = EquilibriumCorrection(model, whole).amplitudes
    kept = choose_cubature(body.mesh, body.basis, body.handles, body.material, count)[0]
    chosen = rng.permutation(len(train))[:_STATES]
    parts = np.where(np.arange(len(chosen)) % 2, rng.uniform(_PART, 1.0, len(chosen)), 1.0)
    states, given = train[chosen], parts[:, None] * amplitudes[chosen]
    fitted = _system(whole, integrated, every, kept, states, given)
    cells, weights = learned_cubature(body, fitted, count)
    some = rng.permutation(len(held_out))[:_STATES]
    judge = _system(whole, integrated, every, kept, held_out[some], held_out_amplitudes[some])
    force, energy = judge.errors(cells, weights)
    return Cubature(cells, weights, energy, force)


def _system(
    body: ReducedBody,
    own: ElasticAmplitudes,
    every: IntArray,
    kept: IntArray,
    states: Array,
    amplitudes: Array,
) -> ForceSystem:
    """Of the cells `kept`, against `every` cell, at states (s, n_rows, dim) and amplitudes (s, K)."""
    kept = np.sort(kept)
    at, volumes = np.searchsorted(every, kept), body.mesh.cell_volumes[every]
    scale, square = dof_scale(body.mesh, body.handles), body.dim**2
    stiffness = _stiffness_at_rest(own, body.rest_rows)
    forces, energies, whole = [], [], []
    for rows, a in zip(states, amplitudes, strict=True):
        tangent = body.handles.tangent(rows) * scale
        here, material = own.field.at(rows), own.elasticity.material
        strained = own.strained(here, a)
        stress = material.first_piola(strained.F).reshape(len(every), square)
        B = own.elasticity.basis_along(tangent) + own.gradients_single @ own.field.row_along(a, tangent)
        by_handles = np.einsum("cp,cpk->kc", stress, B.reshape(len(every), square, -1))
        modes = own.gradients_single @ here.by_amplitude
        by_modes = np.einsum("cp,cpk->kc", stress, modes.reshape(len(every), square, -1))
        by_handles /= np.linalg.norm(by_handles @ volumes)
        by_modes = solve_triangular(stiffness, by_modes, lower=True) / np.sqrt(2.0 * strained.elastic)
        of_cells, density = np.concatenate([by_handles, by_modes]), material.energy_density(strained.F)
        whole.append(of_cells @ volumes)
        forces.append(of_cells[:, at])
        energies.append(density[at] / strained.elastic)
    return ForceSystem(kept, np.array(forces), np.array(energies), np.array(whole))


def _stiffness_at_rest(own: ElasticAmplitudes, rest: Array) -> Array:
    """The lower Cholesky factor of H (K, K)."""
    modes = own.field.at(rest)
    B = (own.gradients_single @ modes.by_amplitude).astype(np.float64)
    strained = own.strained(modes, np.zeros(own.field.count))
    tangent = own.weighted_tangent(strained.F)
    stressed = tangent @ B.reshape(len(tangent), tangent.shape[1], -1)
    return np.asarray(np.linalg.cholesky(B.T @ stressed.reshape(B.shape)))
