"""The compiled sums over contact points agree with their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.rigid.twist import (
    generators,
    own_curvature,
    point_motion,
    relative_curvature,
    rotation_derivatives,
    second_generators,
    touched_body_derivatives,
)

# Sums of a few products of numbers of size one: some units of round-off.
TOLERANCE = 1e-13


@pytest.mark.parametrize("dim", [2, 3])
def test_sums_over_points_agree_with_their_formulas(dim):
    rng = np.random.default_rng(0)
    arms, gradient = rng.normal(size=(2, 5, dim))
    hessian = rng.normal(size=(5, dim, dim))
    B = point_motion(arms)
    np.testing.assert_allclose(B[:, :, dim:], np.einsum("kab,mb->mak", generators(dim), arms), atol=TOLERANCE)
    curved = np.einsum("klab,ma,mb->kl", second_generators(dim), gradient, arms)
    np.testing.assert_allclose(own_curvature(arms, gradient)[dim:, dim:], curved, atol=TOLERANCE)

    slope, pushed, own = touched_body_derivatives(arms, gradient, hessian)
    np.testing.assert_allclose(slope, -np.einsum("mat,ma->t", B, gradient), atol=TOLERANCE)
    np.testing.assert_allclose(pushed, rotation_derivatives(gradient) - hessian @ B, atol=TOLERANCE)
    through = np.einsum("mas,mab,mbt->st", B, hessian, B) + relative_curvature(arms, gradient)
    np.testing.assert_allclose(own, through, atol=TOLERANCE)
