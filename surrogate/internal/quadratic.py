"""The internal correction that is quadratic in the state, fitted in closed form to equilibria and their derivatives.

An equilibrium knows its derivatives by every coordinate, so that few states give many conditions: enough to fit the
coefficients c of the components to all products of two inputs z, by least squares with the weights of `slope_task.py`,

    mean_s w_s |c(z_s) - c_s|^2 / mean_s w_s |c_s|^2  +  weight * mean_s |dc(z_s) - dc_s|^2 / mean_s |dc_s|^2.

This is static condensation to the second order (modal derivatives: Idelsohn and Cardona 1985), about all training
states instead of the body at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from scipy.linalg import cho_factor, cho_solve

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.internal.model import QuadraticModel, QuadraticOptions
from softprint.runtime.mechanics.static_condensation import StaticCondensation
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.internal.data import InternalData
from softprint.surrogate.internal.slope_data import SlopeData, read_slope_data
from softprint.surrogate.internal.slopes import EquilibriumSlopes
from softprint.surrogate.learning_task import HeldOutError

# Of the derivatives, all of which are in the sum; and the ridge, as a share of the mean of the diagonal.
_WEIGHT, _RIDGE = 1.0, 1e-11
# Directions in which the inputs of no training state change by more than this, relative to the most, are left out. The
# products of this many take 3 GiB and some minutes.
_LEAST, _MOST = 1e-3, 200


@dataclass(frozen=True, eq=False)
class FittedQuadratic:
    """model; held_out: error of r over the volume in held-out states; discarded: the share of fields and derivatives
    beyond the components."""

    model: QuadraticModel
    held_out: HeldOutError
    discarded: float


def fit_quadratic(
    truth: TruthData,
    body: ReducedBody,
    data: InternalData,
    condensation: StaticCondensation | None,
    components: int,
    seed: int = 0,
    progress: Callable[[int], None] = lambda states: None,
) -> FittedQuadratic:
    """Of the training states of `data`, of the same truth. condensation: of all nodes, for a correction that adds to
    it; progress(n): after n more states, `slope_data.evaluations` in all. Raises SoftprintError for more components
    than there are, and for a body with so many handles that their products do not fit into memory."""
    learned = read_slope_data(
        truth, body, data, EquilibriumSlopes(body, condensation), components, seed, progress
    )
    P = _directions(data, learned)
    if P.shape[1] > _MOST:
        raise SoftprintError(
            f"the state of {body.name!r} changes in {P.shape[1]} directions, and a quadratic correction has all their "
            f"products: at most {_MOST}; use a network, or equilibrium = true"
        )
    fitted = least_squares(data.inputs[data.train] @ P, learned, P, bool(data.gravity))
    options = QuadraticOptions(components, P.shape[1], condensation is not None, data.gravity)
    model = QuadraticModel(options, body.dim, body.n_rows, body.n_nodes)
    for name, values in zip(
        ("modes", "directions", "offset", "linear", "quadratic"), (learned.modes, P, *fitted), strict=True
    ):
        setattr(model, name, torch.from_numpy(values).float())
    return FittedQuadratic(model, _held_out_error(model, data), learned.discarded)


def _held_out_error(model: QuadraticModel, data: InternalData) -> HeldOutError:
    """Error of r over the volume, relative to r itself, in the held-out states."""
    function, modes = model.as_arrays(), model.modes.double().numpy()
    found = np.array([function.value(data.inputs[state]) for state in data.held_out])
    exact = data.fields[data.held_out]
    missed = np.tensordot(found, modes, axes=1) - exact
    return HeldOutError.of(*(np.square(part).sum(axis=2) @ data.volumes for part in (missed, exact)))


def _directions(data: InternalData, learned: SlopeData) -> Array:
    """P (n_inputs, r): the directions in which inputs change, in units of their size; a direction of gravity has the
    unit 1."""
    z, unit = data.inputs[data.train], np.ones(data.inputs.shape[1])
    n_rows = len(unit) - len(data.gravity)
    unit[:n_rows] = np.sqrt(np.square(z[:, :n_rows]).mean())
    moved = learned.input_slopes.reshape(-1, len(unit)) / unit
    both = [part.T @ part / np.square(part).sum() for part in (z / unit, moved)]
    sizes, vectors = np.linalg.eigh(sum(both))
    kept = sizes > _LEAST**2 * sizes[-1]
    return np.asarray(vectors[:, kept] / unit[:, None])


def least_squares(w: Array, learned: SlopeData, P: Array, offset: bool) -> tuple[Array, Array, Array]:
    """d, L and Q of inputs w (s, r), whose coefficients and derivatives are `learned`, along P (n_inputs, r); offset:
    whether there is a d."""
    r = w.shape[1]
    pairs = np.triu_indices(r)
    weights = learned.weights / (learned.weights @ np.square(learned.coefficients).sum(axis=1))
    F = _features(w, pairs)
    gram, right = F.T @ (weights[:, None] * F), F.T @ (weights[:, None] * learned.coefficients)
    share = _WEIGHT / np.square(learned.slopes).sum()
    for state, dz, dc in zip(learned.sloped, learned.input_slopes, learned.slopes, strict=True):
        dF = _feature_slopes(w[state], dz @ P, pairs)
        gram += share * dF.T @ dF
        right += share * dF.T @ dc
    used = len(gram) if offset else len(gram) - 1
    gram, right = gram[:used, :used], right[:used]
    gram[np.diag_indices(used)] += _RIDGE * np.trace(gram) / used
    fitted = cho_solve(cho_factor(gram, overwrite_a=True), right).T
    Q = np.zeros((len(fitted), r, r))
    Q[:, pairs[0], pairs[1]] = fitted[:, r : r + len(pairs[0])]
    d = fitted[:, -1] if offset else np.zeros(len(fitted))
    return d, fitted[:, :r], Q + Q.transpose(0, 2, 1)


def _features(w: Array, pairs: tuple[IntArray, IntArray]) -> Array:
    """w, the products of pairs of it, and 1, of inputs (s, r)."""
    return np.concatenate([w, w[:, pairs[0]] * w[:, pairs[1]], np.ones((len(w), 1))], axis=1)


def _feature_slopes(w: Array, dw: Array, pairs: tuple[IntArray, IntArray]) -> Array:
    """Their derivatives at one input (r,) along changes of it (k, r)."""
    i, j = pairs
    return np.concatenate([dw, dw[:, i] * w[j] + w[i] * dw[:, j], np.zeros((len(dw), 1))], axis=1)
