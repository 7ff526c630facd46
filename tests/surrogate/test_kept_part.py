"""How much of a correction is kept: none of noise, all of a good one, and no jump in between."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.surrogate.force.kept_part import kept_part

FOLDS, SAMPLES, SIZE = 4, 50, 30


def sums(seed: int, share: float, noise: float):
    """x and q of corrections `share` m + noise of what is missed, m, by fold."""
    rng = np.random.default_rng(seed)
    missed = rng.standard_normal((FOLDS, SAMPLES, SIZE))
    correction = share * missed + noise * rng.standard_normal(missed.shape)
    return (correction * missed).sum((1, 2)), (correction * correction).sum((1, 2))


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_kept_of_noise(seed):
    # x of each fold is 0 with a spread of 1 / sqrt(1,500) = 0.026 of q, and one in six is beyond its standard error.
    assert kept_part(*sums(seed, 0.0, 1.0)) < 0.03
    assert kept_part(*sums(seed, -0.5, 0.1)) == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_a_good_correction_is_left_alone(seed):
    """All of one that is right, and of one that is too small; none becomes larger."""
    assert kept_part(*sums(seed, 0.9, 0.1)) == 1.0
    assert kept_part(*sums(seed, 0.5, 0.0)) == 1.0


@pytest.mark.parametrize("seed", range(5))
def test_what_is_kept_lowers_the_error(seed):
    """A correction with as much noise as truth has a best share of a half, of which a little less is kept."""
    cross, square = sums(seed, 1.0, 1.0)
    kept = kept_part(cross, square)
    assert 0.45 < kept <= cross.sum() / square.sum()
    assert kept**2 * square.sum() < 2.0 * kept * cross.sum()


def test_folds_that_disagree_are_believed_less():
    square = np.ones(4)
    alike, apart = np.full(4, 0.6), np.array([0.1, 0.3, 0.9, 1.1])
    assert kept_part(alike, square) == pytest.approx(0.6)
    # Standard error of a mean of four: the standard deviation over two.
    assert kept_part(apart, square) == pytest.approx(0.6 - apart.std(ddof=1) / 2.0)


def test_it_has_no_jump():
    """From noise to truth."""
    noise, truth = sums(0, 0.0, 1.0), sums(0, 1.0, 0.0)
    kept = [
        kept_part(*((1.0 - mix) * a + mix * b for a, b in zip(noise, truth, strict=True)))
        for mix in np.linspace(0.0, 1.0, 201)
    ]
    assert kept[0] < 0.03
    assert kept[-1] == pytest.approx(1.0)
    assert np.abs(np.diff(kept)).max() < 0.02
    assert kept_part(np.zeros(3), np.zeros(3)) == 0.0
