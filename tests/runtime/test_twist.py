"""The compiled sums over touching points against the formulas that they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.rigid.twist import (
    felt_by_the_other,
    generators,
    own_curvature,
    point_motion,
    relative_curvature,
    second_generators,
    turned_along,
)

# Sums of a few products of numbers of size one: some units of round-off.
TOLERANCE = 1e-13


@pytest.mark.parametrize("dim", [2, 3])
def test_sums_over_points_are_their_formulas(dim):
    rng = np.random.default_rng(0)
    arms, gradient = rng.normal(size=(2, 5, dim))
    hessian = rng.normal(size=(5, dim, dim))
    B = point_motion(arms)
    np.testing.assert_allclose(B[:, :, dim:], np.einsum("kab,mb->mak", generators(dim), arms), atol=TOLERANCE)
    curved = np.einsum("klab,ma,mb->kl", second_generators(dim), gradient, arms)
    np.testing.assert_allclose(own_curvature(arms, gradient)[dim:, dim:], curved, atol=TOLERANCE)

    slope, pushed, own = felt_by_the_other(arms, gradient, hessian)
    np.testing.assert_allclose(slope, -np.einsum("mat,ma->t", B, gradient), atol=TOLERANCE)
    np.testing.assert_allclose(pushed, turned_along(gradient) - hessian @ B, atol=TOLERANCE)
    through = np.einsum("mas,mab,mbt->st", B, hessian, B) + relative_curvature(arms, gradient)
    np.testing.assert_allclose(own, through, atol=TOLERANCE)
