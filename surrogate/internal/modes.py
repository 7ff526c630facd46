"""The modes of an internal correction in elastic equilibrium, from the states of a truth, without training.

Modes are principal components of the training fields and of random combinations of the derivatives of some states, in
the norm of energy and volume (`norm.py`), in equal parts: forces on the handles need displacements in every direction
that a state can be moved in, and the states themselves show only few. Amplitudes are found by the simulation; what is
fitted here is a first estimate of them, linear in the state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.learned.internal.correction import mapped
from softprint.runtime.learned.internal.equilibrium.correction import EquilibriumCorrection
from softprint.runtime.learned.internal.file import with_cubature
from softprint.runtime.learned.internal.model import ModesModel, ModesOptions
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.internal.data import InternalData
from softprint.surrogate.internal.modes_cubature import modes_cubature
from softprint.surrogate.internal.norm import CorrectionNorm
from softprint.surrogate.internal.slope_data import MIXED, combined, state_weights
from softprint.surrogate.internal.slopes import EquilibriumSlopes
from softprint.surrogate.internal.task import RIDGE
from softprint.surrogate.learning_task import HeldOutError

# The size of the combinations of derivatives among the fields, relative to these. On the small Hand with all cells, 60
# modes leave 2.5 % of the forces on the handles with equal parts, and 9.7 % without derivatives; of the displacement
# 12 % and 5 %.
_SHARE = 1.0


@dataclass(frozen=True, eq=False)
class FoundModes:
    """model, with the cubature that its amplitudes are found on; held_out: error of the displacement in held-out
    states; discarded: the share of fields and derivatives beyond the modes; unsolved: held-out states whose amplitudes
    were not found."""

    model: ModesModel
    cubature: Cubature
    held_out: HeldOutError
    discarded: float
    unsolved: int


def find_modes(
    truth: TruthData,
    body: ReducedBody,
    data: InternalData,
    count: int,
    cells: int | None = None,
    seed: int = 0,
    progress: Callable[[int], None] = lambda states: None,
) -> FoundModes:
    """The first `count` modes of the training states of `data`, of the same truth, on the subspace. cells: of their own
    cubature, by default that of the body; progress(n): after n more states. Raises SoftprintError for more modes
    than there are."""
    rows, rng = truth.states["rows"], np.random.default_rng(seed)
    fields = data.fields[data.train]
    norm, slopes = CorrectionNorm(body, fields), EquilibriumSlopes(body)

    def slope_of(place: int) -> Array:
        state = data.train[place]
        progress(1)
        return slopes.at(rows[state], truth.internal(state), fields[place])

    mixed = np.concatenate([combined(slope_of(p), rng) for p in rng.permutation(len(fields))[:MIXED]])
    weighted = fields * np.sqrt(state_weights(norm, fields))[:, None, None]
    share = np.sqrt(_SHARE * norm.squares(weighted).sum() / norm.squares(mixed).sum())
    modes, discarded = norm.components(np.concatenate([weighted, share * mixed]), count)
    modes[:, body.handles.frame_nodes] = 0.0  # round-off
    amplitudes = fields.reshape(len(fields), -1) @ norm.dual(modes).T
    model = _with_estimate(body, modes, data.gravity, data.inputs[data.train], amplitudes)
    cubature = body.cubature
    if cells is not None:
        known = data.held_out
        judged = data.fields[known].reshape(len(known), -1) @ norm.dual(modes).T
        states = rows[data.train], amplitudes, rows[known], judged
        cubature = modes_cubature(body, model, *states, cells, rng)
    held_out, unsolved = _held_out(body, model, cubature, data, rows)
    return FoundModes(model, cubature, held_out, discarded, unsolved)


def evaluations(data: InternalData) -> int:
    """How many states `find_modes` reports."""
    return min(len(data.train), MIXED)


def _with_estimate(
    body: ReducedBody, modes: Array, gravity: tuple[float, ...], inputs: Array, amplitudes: Array
) -> ModesModel:
    """With the ridge regression of amplitudes (s, K) on inputs (s, n_inputs), through zero at rest without gravity."""
    model = ModesModel(ModesOptions(len(modes), gravity), body.dim, body.n_rows, body.n_nodes)
    mean = inputs.mean(axis=0) if gravity else np.zeros(inputs.shape[1])
    middle = amplitudes.mean(axis=0) if gravity else np.zeros(len(modes))
    scale = np.maximum(inputs.std(axis=0), 1e-3 * inputs.std(axis=0).max())
    z = (inputs - mean) / scale
    gram = z.T @ z + RIDGE * len(z) * np.eye(z.shape[1])
    linear = np.linalg.solve(gram, z.T @ (amplitudes - middle)).T / scale
    model.modes = torch.from_numpy(modes).float()
    model.linear = torch.from_numpy(linear).float()
    model.offset = torch.from_numpy(middle - linear @ mean).float()
    return model


def _held_out(
    body: ReducedBody, model: ModesModel, cubature: Cubature, data: InternalData, rows: Array
) -> tuple[HeldOutError, int]:
    """The error of the displacement over the volume, relative to the displacement, and how many states were not
    solved."""
    correction = EquilibriumCorrection(model, with_cubature(body, cubature))
    bound, gradient = correction.bind(), correction.gradient
    missed, whole, unsolved = [], [], 0
    for state in data.held_out:
        exact = mapped(gradient, rows[state], data.fields[state])
        error = bound.displacement(rows[state]) - exact
        unsolved += not correction.amplitudes.at(rows[state]).converged
        missed.append(float(np.square(error).sum(axis=1) @ data.volumes))
        whole.append(float(np.square(exact).sum(axis=1) @ data.volumes))
    return HeldOutError.of(np.array(missed), np.array(whole)), unsolved
