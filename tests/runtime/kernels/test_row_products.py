"""Positions and deformation gradients from handle rows agree with matrix products."""

import numpy as np
import pytest

from softprint.runtime.linalg.row_products import deformed, placed, placed_some

# Sums of some tens of products of order one, in another order.
ROUND_OFF = 1e-13


@pytest.mark.parametrize("dim", [2, 3])
def test_they_agree_with_matrix_products(dim):
    rng = np.random.default_rng(dim)
    basis, rows = rng.normal(size=(50, 23)), rng.normal(size=(23, dim))
    gradients = rng.normal(size=(50, dim, 23))
    index = np.array([7, 0, 7, 49])
    np.testing.assert_allclose(placed(basis, rows), basis @ rows, atol=ROUND_OFF)
    np.testing.assert_allclose(placed_some(basis, rows, index), basis[index] @ rows, atol=ROUND_OFF)
    np.testing.assert_allclose(
        deformed(gradients, rows), rows.T @ gradients.transpose(0, 2, 1), atol=ROUND_OFF
    )


def test_single_precision_is_summed_in_double():
    rng = np.random.default_rng(0)
    gradients, rows = rng.normal(size=(50, 3, 64)).astype(np.float32), rng.normal(size=(64, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    F = deformed(gradients, rows)
    np.testing.assert_allclose(deformed(gradients, rows @ turn.T), turn @ F, atol=ROUND_OFF)
    np.testing.assert_allclose(F, deformed(gradients.astype(np.float64), rows), atol=ROUND_OFF)


def test_no_points():
    assert placed(np.empty((0, 5)), np.ones((5, 3))).shape == (0, 3)
    assert deformed(np.empty((0, 3, 5)), np.ones((5, 3))).shape == (0, 3, 3)
