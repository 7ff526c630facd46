"""The coefficients that a correction is trained on with their derivatives.

Components are those of the training fields and of random combinations of the derivatives of some states, in the norm of
energy and volume (`norm.py`). Fields are weighted by 1 / (|r|^2 + floor), so that states that are hardly deformed are
learned as well as others, relative to themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.learned.internal.inputs import RigidFreeRows
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.internal.data import InternalData
from softprint.surrogate.internal.norm import CorrectionNorm
from softprint.surrogate.internal.slopes import EquilibriumSlopes

# The floor of the weights, relative to the mean square; the size of the combinations of derivatives among the fields
# that components are found of, as a share of these.
_FLOOR, _SHARE = 0.03, 0.1
# At most this many states have derivatives; components are of those of this many, in this many combinations of each.
# 180 states of the Auxetic with derivatives do as well as 540.
_SLOPED, MIXED, _COMBINATIONS = 240, 48, 8


@dataclass(frozen=True, eq=False)
class SlopeData:
    """Of s training states, t of which have derivatives. modes: (count, n_nodes, dim), orthonormal in the norm;
    discarded: the share beyond them; weights: (s,) of the states, relative; coefficients: (s, count); sloped: (t,)
    which states; input_slopes: (t, n_dofs, n_inputs) and slopes (t, n_dofs, count): derivatives of inputs and
    coefficients along the coordinates, each in its unit."""

    modes: Array
    discarded: float
    weights: Array
    coefficients: Array
    sloped: IntArray
    input_slopes: Array
    slopes: Array


def read_slope_data(
    truth: TruthData,
    body: ReducedBody,
    data: InternalData,
    slopes: EquilibriumSlopes,
    count: int,
    seed: int = 0,
    progress: Callable[[int], None] = lambda states: None,
) -> SlopeData:
    """Of the training states of `data`, of the same truth; count: of components; progress(n): after n more states."""
    rows, rng = truth.states["rows"], np.random.default_rng(seed)
    fields = data.fields[data.train]
    norm = CorrectionNorm(body, fields)

    def slope_of(place: int) -> Array:
        state = data.train[place]
        progress(1)
        return slopes.at(rows[state], truth.internal(state), fields[place])

    weights = state_weights(norm, fields)
    sloped = rng.permutation(len(fields))[:_SLOPED]
    mixed = np.concatenate([combined(slope_of(place), rng) for place in sloped[:MIXED]])
    weighted = fields * np.sqrt(weights)[:, None, None]
    share = np.sqrt(
        _SHARE * norm.squares(weighted).sum() / max(norm.squares(mixed).sum(), np.finfo(float).tiny)
    )
    modes, discarded = norm.components(np.concatenate([weighted, share * mixed]), count)
    dual, encode = norm.dual(modes), RigidFreeRows.of(body, data.gravity)
    of_inputs, of_coefficients = [], []
    for place in sloped:
        own = rows[data.train[place]]
        of_inputs.append((encode.derivative(own) @ slopes.tangent(own)).T)
        of_coefficients.append((dual @ slope_of(place).reshape(dual.shape[1], -1)).T)
    return SlopeData(
        modes,
        discarded,
        weights,
        fields.reshape(len(fields), -1) @ dual.T,
        sloped,
        np.array(of_inputs),
        np.array(of_coefficients),
    )


def evaluations(data: InternalData) -> int:
    """How many states `read_slope_data` reports."""
    return min(len(data.train), _SLOPED) + min(len(data.train), MIXED)


def state_weights(norm: CorrectionNorm, fields: Array) -> Array:
    """1 / (|r|^2 + floor) (s,) of fields (s, n_nodes, dim)."""
    return 1.0 / (norm.squares(fields) + _FLOOR)


def combined(slope: Array, rng: np.random.Generator) -> Array:
    """Random combinations (k, n_nodes, dim) of a derivative (n_nodes, dim, n_dofs)."""
    return np.moveaxis(slope @ rng.normal(size=(slope.shape[2], _COMBINATIONS)), 2, 0)
