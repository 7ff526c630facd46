"""A kept Hessian is the one that was found until the body is strained otherwise."""

import numpy as np
import pytest

from runtime.dynamics.corrected_points import CorrectedPoints
from runtime.dynamics.terms.elastic import ElasticEnergy
from runtime.dynamics.terms.kept_elastic_hessian import _SAME, KeptElasticHessian, kept_if_dear
from runtime.elasticity.reduced_elasticity import ReducedElasticity


@pytest.fixture
def both(jelly_body):
    """An elastic energy, and the same with its Hessian kept."""
    exact = ElasticEnergy(jelly_body, CorrectedPoints(jelly_body, []))
    return exact, KeptElasticHessian(exact, ReducedElasticity.of(jelly_body))


def bent(body, size, seed=1):
    return body.rest_rows + size * np.random.default_rng(seed).normal(size=body.rest_rows.shape)


def test_energy_and_gradient_are_exact_and_the_hessian_is_that_of_a_state_nearby(jelly_body, dim, both):
    exact, kept = both
    turn = jelly_body.rest_rows
    first = bent(jelly_body, 1e-3)
    hessian = kept.linearise(first, turn, None)[2]()
    np.testing.assert_array_equal(hessian, exact.linearise(first, turn, None)[2]())
    near = first + 1e-6 * np.random.default_rng(2).normal(size=first.shape)
    energy, gradient, second = kept.linearise(near, turn, None)
    assert energy == exact.energy(near, turn, None)
    np.testing.assert_array_equal(gradient, exact.linearise(near, turn, None)[1])
    np.testing.assert_array_equal(second(), hessian)


def test_directions_that_turn_with_the_body_keep_what_was_found_along_them(jelly_body, dim, both):
    exact, kept = both
    turn, first = jelly_body.rest_rows, bent(jelly_body, 1e-3)
    along = np.random.default_rng(3).normal(size=(first.size, 4))
    hessian = kept.linearise(first, turn, None)[2](along)
    np.testing.assert_array_equal(hessian, exact.linearise(first, turn, None)[2](along))
    near = first + 1e-6 * np.random.default_rng(2).normal(size=first.shape)
    np.testing.assert_array_equal(kept.linearise(near, turn, None)[2](along * (1.0 + 1e-6)), hessian)
    # By the rows it is another matrix.
    np.testing.assert_array_equal(
        kept.linearise(near, turn, None)[2](), exact.linearise(near, turn, None)[2]()
    )


def test_another_strain_has_another_hessian(jelly_body, dim, both):
    exact, kept = both
    turn, first = jelly_body.rest_rows, bent(jelly_body, 1e-3)
    kept.linearise(first, turn, None)[2]()
    stretched = first * (1.0 + 2.0 * _SAME)
    np.testing.assert_array_equal(
        kept.linearise(stretched, turn, None)[2](), exact.linearise(stretched, turn, None)[2]()
    )


def test_only_what_is_dear_is_kept(jelly_body, both):
    exact, _ = both
    assert kept_if_dear(exact, ReducedElasticity.of(jelly_body)) is exact
