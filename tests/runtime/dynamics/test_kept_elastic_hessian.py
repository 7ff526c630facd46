"""A reused elastic Hessian stays valid until the strain of the body changes."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, NewtonSettings, Simulator
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms import kept_elastic_hessian
from softprint.runtime.dynamics.terms.elastic import ElasticEnergy
from softprint.runtime.dynamics.terms.kept_elastic_hessian import _SAME_STRAIN, HessianReuse


@pytest.fixture
def elastic(jelly_body):
    """The elastic energy of a block."""
    return ElasticEnergy(jelly_body, CorrectedPoints(jelly_body, []))


@pytest.fixture
def reuse(jelly_body):
    """Decides whether to reuse a Hessian of this block."""
    return HessianReuse(jelly_body.reduced_elasticity)


def every(rows):
    """Every coordinate of rows is free."""
    return np.arange(rows.size)


def exact(elastic, rows):
    """Computes the Hessian of a state without reuse, see `RowHessian`."""
    return elastic.in_frame(rows).evaluate(rows, None).linearise(None)[1]


def bent(body, size, seed=1):
    return body.rest_rows + size * np.random.default_rng(seed).normal(size=body.rest_rows.shape)


def test_the_reused_hessian_is_that_of_a_nearby_state(jelly_body, elastic, reuse):
    first = bent(jelly_body, 1e-3)
    kept = reuse.hessian(first, every(first), None, exact(elastic, first), None)
    np.testing.assert_array_equal(kept.hessian, exact(elastic, first)())
    near = first + 1e-6 * np.random.default_rng(2).normal(size=first.shape)
    assert reuse.hessian(near, every(near), None, exact(elastic, near), kept) is kept


def test_corotated_directions_keep_their_hessian(jelly_body, elastic, reuse):
    first = bent(jelly_body, 1e-3)
    along, free = np.random.default_rng(3).normal(size=(first.size, 4)), np.arange(4)
    kept = reuse.hessian(first, free, along, exact(elastic, first), None)
    np.testing.assert_array_equal(kept.hessian, exact(elastic, first)(along))
    near = first + 1e-6 * np.random.default_rng(2).normal(size=first.shape)
    assert reuse.hessian(near, free, along * (1.0 + 1e-6), exact(elastic, near), kept) is kept
    # As many others.
    other = np.random.default_rng(4).normal(size=along.shape)
    found = reuse.hessian(near, free + 2, other, exact(elastic, near), kept)
    np.testing.assert_array_equal(found.hessian, exact(elastic, near)(other))
    # By the rows it is another matrix.
    by_rows = reuse.hessian(near, every(near), None, exact(elastic, near), kept)
    np.testing.assert_array_equal(by_rows.hessian, exact(elastic, near)())


def test_another_strain_has_another_hessian(jelly_body, elastic, reuse):
    first = bent(jelly_body, 1e-3)
    kept = reuse.hessian(first, every(first), None, exact(elastic, first), None)
    stretched = first * (1.0 + 2.0 * _SAME_STRAIN)
    found = reuse.hessian(stretched, every(stretched), None, exact(elastic, stretched), kept)
    np.testing.assert_array_equal(found.hessian, exact(elastic, stretched)())


def test_only_expensive_hessians_are_kept(jelly_body, elastic, monkeypatch):
    elasticity = jelly_body.reduced_elasticity
    assert HessianReuse.if_expensive(elastic, elasticity) is None
    monkeypatch.setattr(kept_elastic_hessian, "_EXPENSIVE", 0.5 * elastic.products)
    assert HessianReuse.if_expensive(elastic, elasticity) is not None


def sagging(body, dim):
    """A block released under gravity."""
    return Simulator(
        body,
        contact=PenaltyContact(1e9),
        gravity=np.append(np.zeros(dim - 1), -9.81),
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(0.01, NewtonSettings(50, 1e-9)),
    )


def test_steps_with_a_reused_hessian_agree_with_others(jelly_body, dim, monkeypatch):
    """Energy and gradient are exact for any Hessian."""
    plain = sagging(jelly_body, dim)
    monkeypatch.setattr(kept_elastic_hessian, "_EXPENSIVE", 0.0)
    keeping = sagging(jelly_body, dim)
    state = plain.step(plain.rest_state()).state
    carried = keeping.step(keeping.rest_state()).state
    assert state.elastic_hessian is None
    assert carried.elastic_hessian is not None
    # Without the factorisation that predicts its end, the step needs the Hessian.
    there = keeping.step(replace(carried, factorisation=None)).state
    assert there.elastic_hessian is carried.elastic_hessian
    # Newton's tolerance, 1e-9 of the forces, of either.
    expected = plain.step(replace(state, factorisation=None)).state
    np.testing.assert_allclose(there.rows, expected.rows, atol=1e-9)
    assert np.abs(there.rows - carried.rows).max() > 1e-5
