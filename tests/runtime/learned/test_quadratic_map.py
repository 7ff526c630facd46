"""Internal corrections that are quadratic in the state: derivatives, invariance, and a fit of what is quadratic."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body.rotations import rotation_dofs, rotation_exponential
from softprint.runtime.learned.internal.correction import InternalCorrection
from softprint.runtime.learned.internal.quadratic_map import QuadraticMap
from tests.internal_model import made_quadratic

N_OUT, N_IN, REDUCED = 4, 9, 6
# Central differences of a quadratic are exact: only round-off is left, 1e-16 over a step of 1e-3.
STEP, ROUND_OFF = 1e-3, 1e-10


@pytest.fixture
def quadratic() -> QuadraticMap:
    rng = np.random.default_rng(5)
    Q = rng.normal(size=(N_OUT, REDUCED, REDUCED))
    return QuadraticMap(
        rng.normal(size=(N_IN, REDUCED)),
        rng.normal(size=N_OUT),
        rng.normal(size=(N_OUT, REDUCED)),
        Q + Q.transpose(0, 2, 1),
    )


def differences(value, z):
    steps = STEP * np.eye(len(z))
    return np.stack([(value(z + step) - value(z - step)) / (2.0 * STEP) for step in steps], axis=-1)


def test_derivatives_are_differences(quadratic):
    rng = np.random.default_rng(6)
    z, a, directions = rng.normal(size=N_IN), rng.normal(size=N_OUT), rng.normal(size=(N_IN, 3))
    at, everywhere = quadratic.at(z), np.eye(N_IN)
    slope = differences(quadratic.value, z)
    curvature = differences(lambda own: a @ quadratic.at(own).moved(everywhere).slope, z)
    np.testing.assert_allclose(at.pulled_back(a), a @ slope, atol=ROUND_OFF)
    along = at.moved(directions)
    np.testing.assert_allclose(along.slope, slope @ directions, atol=ROUND_OFF)
    np.testing.assert_allclose(along.curvature(a), directions.T @ curvature @ directions, atol=ROUND_OFF)


@pytest.mark.parametrize("gravity", [False, True])
def test_a_correction_pulls_forces_back_and_knows_its_curvature(jelly_body, dim, gravity):
    """Of the positions in a bent body, by central differences: 1e-6 of round-off and curvature; the Hessian is in
    single precision."""
    body, rng = jelly_body, np.random.default_rng(4)
    down = tuple(np.linspace(1.0, -9.0, dim)) if gravity else ()
    bound = InternalCorrection(made_quadratic(body, down), body).bind()
    rows = body.handles.retract(
        body.rest_rows, 0.004 * body.handles.units(0.02) * rng.normal(size=body.handles.n_dofs)
    )
    f, step = rng.normal(size=(body.n_nodes, dim)), 1e-6
    moves = step * np.eye(rows.size).reshape(-1, *rows.shape)
    work = [
        np.vdot(f, bound.displacement(rows + m) - bound.displacement(rows - m)) / (2 * step) for m in moves
    ]
    found = bound.linearise(rows).pulled_back(f).ravel()
    np.testing.assert_allclose(found, work, atol=1e-6 * np.abs(work).max())
    bent = [
        (bound.linearise(rows + m).pulled_back(f) - bound.linearise(rows - m).pulled_back(f)).ravel()
        / (2 * step)
        for m in moves
    ]
    hessian = bound.linearise(rows).curvature(f, None)
    np.testing.assert_allclose(hessian, bent, atol=1e-5 * np.abs(bent).max())


def test_a_rigid_motion_of_everything_moves_everything(jelly_body, dim):
    body = jelly_body
    bound = InternalCorrection(made_quadratic(body), body).bind()
    rows = body.handles.retract(
        body.rest_rows, 0.003 * body.handles.units(0.02) * np.ones(body.handles.n_dofs)
    )
    Q = rotation_exponential(np.linspace(0.9, 0.3, rotation_dofs(dim)))
    moved = rows @ Q.T + np.outer(body.handles.affine_part, np.full(dim, 0.3))
    before = bound.displacement(rows)
    assert np.abs(before).max() > 1e-6  # m: there is something to turn
    np.testing.assert_allclose(bound.displacement(moved), before @ Q.T, atol=1e-14)


def test_it_is_zero_at_rest(jelly_body):
    bound = InternalCorrection(made_quadratic(jelly_body), jelly_body).bind()
    np.testing.assert_allclose(bound.displacement(jelly_body.rest_rows), 0.0, atol=1e-15)
