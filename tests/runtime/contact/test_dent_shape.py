"""The measures of contact forces: of one dent, of several that lie apart, and what is invariant of them."""

import numpy as np
import pytest

from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact.learned_energy.dent_shape import DentShape, Pairs, pairs, spread
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy

REACH = 0.01  # m
K = 12


def dent(dim, rng, width):
    """Pressures and places of a dent."""
    return rng.uniform(0.5, 1.0, K), width * rng.normal(size=(K, dim))


def together(*dents):
    return [np.concatenate(column) for column in zip(*dents, strict=True)]


def shape(p, X, owner=None):
    """owner: of points, 0 for all. With a steepness of one in each direction."""
    owner = np.zeros(len(p), dtype=int) if owner is None else owner
    compared = pairs(p, X, owner, REACH)
    return DentShape(Pairs(*compared[:3]), Pairs(*compared[3:]), p.sum(), np.ones_like(X))


@pytest.mark.parametrize("dim", [2, 3])
def test_dents_that_lie_apart_are_counted_and_each_is_as_wide_as_it_is(dim):
    p, X = dent(dim, np.random.default_rng(0), 0.2 * REACH)
    omega, nu = shape(p, X).values
    assert omega > 0.02
    p_of_two, places = together((p, X), (p, X + 100.0 * REACH))
    np.testing.assert_allclose(shape(p_of_two, places).values, [omega, nu + np.log(2.0)], rtol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_point_has_no_width_and_is_one_dent(dim):
    # A hundredth of the reach changes K by 1e-4.
    np.testing.assert_allclose(
        shape(*dent(dim, np.random.default_rng(0), 0.01 * REACH)).values, 0.0, atol=1e-3
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_the_width_is_that_of_a_bell_of_pressure(dim):
    """Pressures exp -|X|^2 / 2 w^2 on a grid: pairs within r are 1 / sqrt(1 + 2 w^2 / r^2) of all in each direction."""
    w = 0.6 * REACH
    grid = np.stack(np.meshgrid(*[np.linspace(-4.0 * w, 4.0 * w, 17)] * (dim - 1)), axis=-1).reshape(
        -1, dim - 1
    )
    X = np.hstack([grid, np.zeros((len(grid), 1))])
    omega, nu = shape(np.exp(-np.square(X).sum(axis=1) / (2.0 * w**2)), X).values
    n = (1.0 + 2.0 * w**2 / REACH**2) ** (0.5 * (dim - 1))
    less = (1.0 + 8.0 * w**2 / REACH**2) ** (0.5 * (dim - 1))
    # The bell ends at four widths, and the grid is half a width wide.
    np.testing.assert_allclose([omega, nu], np.log([less / n, n]), rtol=1e-3)


def test_two_like_dents_have_twice_the_energy_of_one():
    learned = LearnedEnergy.of((0.0, 0.0, 0.0, 0.9, 0.7, 0.3, REACH))
    one, two = (learned.terms(np.array([n * 1e-3, 0.2, np.log(n)])) for n in (1.0, 2.0))
    assert two.value == pytest.approx(2.0 * one.value, rel=1e-14)
    # And the same forces: dW~ = W~_log W dW / W.
    assert two.slope[0] / 2e-3 == pytest.approx(one.slope[0] / 1e-3, rel=1e-14)


def test_dents_of_two_colliders_are_two_wherever_they_are():
    p, X = dent(2, np.random.default_rng(0), 0.2 * REACH)
    omega, nu = shape(p, X).values
    found = shape(*together((p, X), (p, X)), np.repeat([0, 1], K)).values
    np.testing.assert_allclose(found, [omega, nu + np.log(2.0)], rtol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_turning_places_and_stronger_forces_change_nothing(dim):
    p, X = dent(dim, np.random.default_rng(1), REACH)
    turn = rotation_matrix([2.0] if dim == 2 else [1.0, 2.0, -0.5], dim)
    # Round-off.
    np.testing.assert_allclose(shape(7.0 * p, X @ turn.T + 1.0).values, shape(p, X).values, rtol=1e-10)


@pytest.mark.parametrize("dim", [2, 3])
def test_derivatives_by_the_pressures(dim):
    rng, h = np.random.default_rng(2), 1e-6
    p, X = dent(dim, rng, REACH)
    here, (one, other) = shape(p, X), rng.normal(size=(2, K, 1))
    ahead, behind = (shape(p + side * h * other[:, 0], X) for side in (1, -1))
    slope = (ahead.values - behind.values) / (2 * h)
    # Central differences over 1e-6 of pressures near 1: to the square of it, and round-off.
    np.testing.assert_allclose(other[:, 0] @ here.by_pressure, slope, atol=1e-8)
    np.testing.assert_allclose(other[:, 0] @ here.slopes[:, 0], slope, atol=1e-8)
    weights = np.array([0.7, -1.3])
    change = (ahead.by_pressure - behind.by_pressure) @ weights / (2 * h)
    np.testing.assert_allclose(here.curvature(weights, one, other)[0, 0], one[:, 0] @ change, atol=1e-8)


def test_spread_is_the_distance_from_the_middle():
    places = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    assert spread(np.ones(4), 3.0 * places + 7.0) == pytest.approx(3.0)
    assert spread(np.array([1.0, 0.0, 0.0, 0.0]), places) == 0.0
