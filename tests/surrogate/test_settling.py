"""How joints settle, learned from states: found again, judged by other states, and left where it is not worth it."""

import numpy as np
import pytest

from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.joint_settling import Joints, kernel
from softprint.surrogate.force.settling import _by_others, fitted, told
from tests.bent_beam import beam_with_joints, bent

N = 12


@pytest.fixture(scope="module", params=[2, 3], ids=["2d", "3d"])
def beam(request):
    return beam_with_joints(request.param)


@pytest.fixture
def states(beam):
    """Rows of bent states, their angles, and condensation."""
    rng = np.random.default_rng(0)
    rows = np.stack([bent(beam, *rng.uniform(-0.7, 0.7, 3)) for _ in range(N)])
    joints = Joints.of(beam)
    theta = np.stack([joints.angles(own) for own in rows])
    return rows, theta, compute_mechanics(beam, 100, condensation=True).condensation


def internal(condensation, rows, missed):
    """Displacements in equilibrium that condensation misses by e (s, n, dim) in its own frames."""
    found = []
    for own, e in zip(rows, missed, strict=True):
        corotated = condensation.corotated(own)
        found.append(corotated.displacement(own) + np.einsum("nab,nb->na", corotated.rotations, e))
    return np.array(found)


def test_what_is_quadratic_in_the_angles_is_found_again(beam, states):
    rows, theta, condensation = states
    rng = np.random.default_rng(1)
    linear, square = 1e-3 * rng.normal(size=(2, beam.n_nodes, beam.dim, 2))
    bend = theta[..., -1]
    missed = np.einsum("ndj,sj->snd", linear, bend) + np.einsum("ndj,sj->snd", square, bend**2)
    found = fitted(Joints.of(beam), condensation, rows, internal(condensation, rows, missed), beam.node_mass)
    assert found.states == N
    # The ridge takes a part of it.
    assert found.learned < 0.25 * found.condensation
    other = bent(beam, 0.1, 0.5, -0.3)
    at = Joints.of(beam).angles(other)[:, -1]
    expected = linear @ at + square @ at**2
    error = found.settling.displacement(other) - expected
    assert np.linalg.norm(error) < 0.25 * np.linalg.norm(expected)
    assert "->" in told(found)


def test_errors_are_those_of_states_left_out(states):
    """As if each were fitted by all others, with the same ridge."""
    _, theta, _ = states
    K, missed, ridge = kernel(theta, theta), np.random.default_rng(2).normal(size=(N, 4)), 0.3
    _, errors = _by_others(K, ridge, missed)
    penalty = ridge * np.trace(K) / N
    for out in range(N):
        others = np.delete(np.arange(N), out)
        weights = np.linalg.solve(K[np.ix_(others, others)] + penalty * np.eye(N - 1), missed[others])
        # Round-off.
        np.testing.assert_allclose(errors[out], missed[out] - K[out, others] @ weights, atol=1e-9)


def test_what_angles_do_not_tell_is_left(beam, states):
    rows, _, condensation = states
    missed = 1e-3 * np.random.default_rng(3).normal(size=(N, beam.n_nodes, beam.dim))
    found = fitted(Joints.of(beam), condensation, rows, internal(condensation, rows, missed), beam.node_mass)
    assert found.settling is None
    assert found.learned == found.condensation
    assert "static condensation" in told(found)


def test_joints_that_no_state_bends_teach_nothing(beam, states):
    """All frames are held, as those of a finger that is pressed, or move as one."""
    _, _, condensation = states
    shift = np.outer(beam.handles.affine_part, np.full(beam.dim, 0.01))
    rows = np.stack([beam.rest_rows + step * shift for step in range(N)])
    missed = 1e-3 * np.random.default_rng(4).normal(size=(N, beam.n_nodes, beam.dim))
    found = fitted(Joints.of(beam), condensation, rows, internal(condensation, rows, missed), beam.node_mass)
    assert found.settling is None
    still = fitted(Joints.of(beam), condensation, rows, np.zeros_like(missed), beam.node_mass)
    assert np.isfinite(still.condensation)
