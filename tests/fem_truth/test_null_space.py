"""The projector of thesis 5.3.3: it projects onto the right space and refuses dependent columns."""

import numpy as np
import pytest

from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.runtime.errors import SoftprintError


@pytest.fixture
def space():
    basis = np.random.default_rng(0).standard_normal((50, 7))
    return basis, np.arange(5), NullSpace(basis, np.arange(5))


def test_projects_onto_the_null_space(space):
    basis, fixed, null_space = space
    v = np.random.default_rng(1).standard_normal((50, 3))
    projected = null_space.project(v)
    np.testing.assert_allclose(basis.T @ projected, 0.0, atol=1e-13)
    np.testing.assert_array_equal(projected[fixed], 0.0)
    np.testing.assert_allclose(null_space.project(projected), projected, atol=1e-14)
    assert null_space.violation(projected) < 1e-13
    assert null_space.violation(v) > 0.1


def test_is_orthogonal_and_matches_the_formula(space):
    basis, fixed, null_space = space
    free = basis.copy()
    free[fixed] = 0.0
    formula = np.eye(50) - free @ np.linalg.solve(free.T @ free, free.T)
    formula[fixed] = 0.0
    np.testing.assert_allclose(null_space.project(np.eye(50)), formula, atol=1e-13)


def test_without_columns_only_fixed_nodes_are_constrained():
    null_space = NullSpace(np.zeros((4, 0)), np.array([1]))
    np.testing.assert_array_equal(null_space.project(np.ones((4, 2)))[:, 0], [1, 0, 1, 1])


def test_refuses_dependent_columns():
    basis = np.random.default_rng(0).standard_normal((50, 3))
    with pytest.raises(SoftprintError, match="linearly dependent"):
        NullSpace(np.column_stack([basis, basis @ [1.0, 2.0, 3.0]]), np.arange(0))
    with pytest.raises(SoftprintError, match="leaves no free unknowns"):
        NullSpace(basis, np.arange(48))
