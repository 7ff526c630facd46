"""The measures of contact forces: of one dent, of several that lie apart, and what is invariant of them."""

import numpy as np
import pytest

from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact.learned_energy.dent_shape import dent_shape, spread
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy

REACH = 0.01  # m
K = 12


def dent(dim, rng):
    """Forces of a dent much smaller than the reach: pressures, penetrations, normals, curvatures and places."""
    g = rng.normal(size=(K, dim)) + 3.0 * np.eye(dim)[-1]
    g /= np.linalg.norm(g, axis=1, keepdims=True)
    places = 0.01 * REACH * rng.normal(size=(K, dim))
    return rng.uniform(0.5, 1.0, K), rng.uniform(0.5, 1.0, K), g, np.zeros((K, dim, dim)), places


def together(*dents):
    return [np.concatenate(column) for column in zip(*dents, strict=True)]


def measures(parts, owner=None):
    """(psi, rho, nu), with the first four points of each dent pressed by sharp points; owner: of points, 0 for all."""
    points = np.arange(len(parts[0]))
    owner = np.zeros_like(points) if owner is None else owner
    return dent_shape(*parts, owner, points % K < 4, REACH)[0]


@pytest.mark.parametrize("dim", [2, 3])
def test_dents_that_lie_apart_are_counted_and_compared_each_by_itself(dim):
    one = dent(dim, np.random.default_rng(0))
    turn = rotation_matrix([2.0] if dim == 2 else [1.0, 2.0, -0.5], dim)
    # Elsewhere, and pressed from another side.
    other = (*one[:2], one[2] @ turn.T, one[3], one[4] + 100.0 * REACH)
    psi, rho, nu = measures(one)
    force, total = (one[0][:, None] * one[2]).sum(axis=0), one[0].sum()
    # A hundredth of the reach changes the kernel by 1e-4.
    assert rho == pytest.approx((force @ force) / total**2, rel=1e-3)
    assert nu == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(measures(together(one, other)), [psi, rho, nu + np.log(2.0)], rtol=1e-12)


def test_two_like_dents_have_twice_the_energy_of_one():
    learned = LearnedEnergy.of((0.0, 0.0, 0.0, 0.9, 0.7, 0.3, REACH))
    one, two = (learned.terms(np.array([n * 1e-3, 0.2, 0.9, np.log(n)])) for n in (1.0, 2.0))
    assert two.value == pytest.approx(2.0 * one.value, rel=1e-14)
    # And the same forces: dW~ = W~_log W dW / W.
    assert two.slope[0] / 2e-3 == pytest.approx(one.slope[0] / 1e-3, rel=1e-14)


def test_dents_of_two_colliders_are_two_wherever_they_are():
    one, other = (dent(2, np.random.default_rng(0)) for _ in range(2))
    owner = np.repeat([0, 1], K)
    psi, rho, nu = measures(one)
    np.testing.assert_allclose(
        measures(together(one, other), owner), [psi, rho, nu + np.log(2.0)], rtol=1e-12
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_turning_forces_and_places_changes_nothing(dim):
    rng = np.random.default_rng(1)
    p, e, g, H, X = together(*(dent(dim, rng) for _ in range(2)))
    X = REACH * rng.normal(size=X.shape)
    turn = rotation_matrix([2.0] if dim == 2 else [1.0, 2.0, -0.5], dim)
    # Round-off.
    np.testing.assert_allclose(
        measures((p, e, g @ turn.T, H, X @ turn.T + 1.0)), measures((p, e, g, H, X)), rtol=1e-10
    )


def test_forces_all_around_have_no_direction_and_still_a_measure():
    g = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    values, slopes, *_ = dent_shape(
        np.ones(4),
        np.ones(4),
        g,
        np.zeros((4, 2, 2)),
        np.zeros((4, 2)),
        np.zeros(4, dtype=int),
        np.zeros(4, dtype=bool),
        REACH,
    )
    assert values[1] == 0.0
    assert np.isfinite(slopes).all()


def test_spread_is_the_distance_from_the_middle():
    places = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    assert spread(np.ones(4), 3.0 * places + 7.0) == pytest.approx(3.0)
    assert spread(np.array([1.0, 0.0, 0.0, 0.0]), places) == 0.0
