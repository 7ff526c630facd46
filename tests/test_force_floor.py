"""What is left of a smooth change is scatter, and a model that is off by a factor is so smoothly."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.force_floor import DEGREE, OFFSETS, cubic, figures

PLACES = np.linspace(-1.0, 1.0, OFFSETS)


def smooth(rng, n):
    """Cubics (n_offsets, n) about 5."""
    return 5.0 + np.polynomial.polynomial.polyval(PLACES, rng.normal(size=(DEGREE + 1, n))).T


def test_a_cubic_is_its_own():
    values = smooth(np.random.default_rng(0), 4)
    np.testing.assert_allclose(cubic(values), values, rtol=1e-12)  # round-off


def test_smooth_forces_have_no_scatter_and_an_error_of_a_factor_is_smooth():
    true = [smooth(np.random.default_rng(seed), 3) for seed in range(4)]
    scatter, error, of_cubic = figures(true, [1.1 * one for one in true])
    assert scatter < 1e-12  # round-off
    assert error == pytest.approx(0.1, rel=1e-12)
    assert of_cubic == pytest.approx(0.1, rel=1e-12)


def test_noise_is_found_whatever_the_cubics_take_of_it():
    rng, noise = np.random.default_rng(1), 0.3
    exact = [smooth(rng, 6) for _ in range(200)]
    true = [one + noise * rng.normal(size=one.shape) for one in exact]
    size = np.sqrt(np.mean([np.square(one).mean() for one in true]))
    scatter, error, of_cubic = figures(true, exact)
    # 200 x 6 x 9 independent numbers: their RMS is known to a hundredth.
    assert scatter == pytest.approx(noise / size, rel=0.03)
    # A perfect model is off by the noise, of which a cubic takes four of thirteen parts.
    assert error == pytest.approx(noise / size, rel=0.03)
    assert of_cubic == pytest.approx(noise / size * np.sqrt((DEGREE + 1) / OFFSETS), rel=0.05)
