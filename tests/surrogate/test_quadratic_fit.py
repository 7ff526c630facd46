"""Quadratic internal corrections: the least squares, and what a fit to a truth of states knows."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.internal.correction import InternalCorrection
from softprint.runtime.learned.internal.file import load_internal, save_internal
from softprint.runtime.learned.internal.model import QuadraticModel
from softprint.runtime.learned.internal.quadratic_map import QuadraticMap
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.internal.data import read_internal_data
from softprint.surrogate.internal.entry import train_internal
from softprint.surrogate.internal.quadratic import fit_quadratic, least_squares
from softprint.surrogate.internal.slope_data import SlopeData
from softprint.surrogate.train import TrainingSettings
from tests.internal_truth import written_truth

# Of a linear part alone: one step that moves nothing.
LINEAR = TrainingSettings(steps=1, batch=32, learning_rate=1e-9, weight_decay=0.0, validations=1, seed=0)


@pytest.mark.parametrize("offset", [False, True])
def test_least_squares_find_what_is_quadratic(offset):
    """From fewer states than there are products of inputs, which their derivatives determine; to round-off, through
    the squares of the condition of the products."""
    rng, n_in, r, n_out, states = np.random.default_rng(3), 11, 9, 4, 20
    P = np.linalg.qr(rng.normal(size=(n_in, r)))[0]
    Q = rng.normal(size=(n_out, r, r))
    d = rng.normal(size=n_out) if offset else np.zeros(n_out)
    true = QuadraticMap(P, d, rng.normal(size=(n_out, r)), Q + Q.transpose(0, 2, 1))
    z, moved = rng.normal(size=(states, n_in)), rng.normal(size=(states, r, n_in))
    slopes = np.array([true.at(own).moved(dz.T).slope.T for own, dz in zip(z, moved, strict=True)])
    values = np.array([true.value(own) for own in z])
    learned = SlopeData(np.empty(0), 0.0, np.ones(states), values, np.arange(states), moved, slopes)
    assert states < r * (r + 1) // 2
    for found, expected in zip(
        least_squares(z @ P, learned, P, offset), (true.offset, true.linear, true.quadratic), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("condensed", [False, True])
def test_a_fit_is_nearer_to_full_space_than_a_linear_one(body, condensation, truth_path, condensed, tmp_path):
    """On states that were held out, and the same after a file."""
    own = condensation if condensed else None
    with load_truth(truth_path, body) as truth:
        data = read_internal_data(truth, body, own)
        fitted = fit_quadratic(truth, body, data, own, 10)
        again = fit_quadratic(truth, body, data, own, 10)
        linear = train_internal(truth, body, own, (8, 8), 10, True, LINEAR)
        state, truth_hash = int(data.held_out[0]), truth.content_hash
        rows, exact = truth.states["rows"][state], truth.internal(state)
    assert fitted.held_out == again.held_out
    assert fitted.held_out.rms < 0.5 * linear.held_out.rms
    path = tmp_path / "quadratic.safetensors"
    save_internal(path, fitted.model, body, truth_hash, fitted.held_out.rms)
    header, model, _ = load_internal(path, body)
    assert header.form == "quadratic"
    assert isinstance(model, QuadraticModel)
    assert model.options == fitted.model.options
    before, after = (
        InternalCorrection(each, body).bind().displacement(rows) for each in (fitted.model, model)
    )
    np.testing.assert_allclose(before, after, atol=1e-16)  # sums in the order of arrays in memory
    start = own.corotated(rows).displacement(rows) if own is not None else np.zeros_like(exact)
    assert np.linalg.norm(start + after - exact) < 0.1 * np.linalg.norm(exact)


def test_under_gravity_it_knows_how_the_body_lies(body, tmp_path):
    """In a heavy body that is turned every way."""
    gravity = (0.0, -100.0)
    with load_truth(written_truth(body, tmp_path / "truth.h5", gravity, gravity), body) as truth:
        data = read_internal_data(truth, body, None)
        fitted = fit_quadratic(truth, body, data, None, 10)
    assert fitted.model.options.gravity == gravity
    assert fitted.held_out.rms < 0.1
    at_rest = InternalCorrection(fitted.model, body).bind().displacement(body.rest_rows)
    assert np.abs(at_rest).max() > 1e-5  # m: it sags


def test_more_directions_than_fit_into_memory_are_refused(body, truth_path, monkeypatch):
    monkeypatch.setattr("softprint.surrogate.internal.quadratic._MOST", 3)
    with load_truth(truth_path, body) as truth:
        data = read_internal_data(truth, body, None)
        with pytest.raises(SoftprintError, match="directions, and a quadratic correction has all their products"):
            fit_quadratic(truth, body, data, None, 4)
