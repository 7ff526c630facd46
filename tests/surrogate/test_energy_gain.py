"""The gain of a learned energy over linear mechanics: when it is significant, and its standard error."""

import numpy as np
import pytest

from softprint.surrogate.force.energy_gain import gain_of
from softprint.surrogate.force.sampled_contacts import LABELS, Sampled

CONTACTS, DEPTHS = 40, 5
ALL = np.arange(CONTACTS * DEPTHS)


def sampled(missed):
    """Samples whose forces are off by (contacts, depths); all that is true is one."""
    true = {kind: np.ones((len(ALL), 1)) for kind in LABELS}
    found = {kind: values + missed.reshape(-1, 1) for kind, values in true.items()}
    slopes = {kind: np.zeros((len(ALL), 1)) for kind in LABELS}
    return Sampled(ALL, np.repeat(np.arange(CONTACTS), DEPTHS), true, found, slopes, np.full(len(ALL), False))


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def test_the_mean_is_the_difference_of_the_errors(rng):
    before, after = (sampled(rng.standard_normal((CONTACTS, DEPTHS))) for _ in range(2))
    mean = gain_of(after, before, ALL, LABELS).mean
    assert mean == pytest.approx(sum(before.errors(ALL).values()) - sum(after.errors(ALL).values()))


def test_the_standard_error_is_that_of_other_contacts(rng):
    """Against the scatter over a thousand draws of contacts."""

    def drawn():
        size = rng.uniform(0.1, 0.3, (CONTACTS, 1)) * np.ones(DEPTHS)
        return gain_of(sampled(size * rng.uniform(0.5, 1.2, (CONTACTS, 1))), sampled(size), ALL, LABELS)

    gains = [drawn() for _ in range(1000)]
    scatter = np.std([gain.mean for gain in gains])
    # A tenth: the jackknife's own error with 40 contacts, and that the root of a mean is not linear.
    assert np.mean([gain.standard_error for gain in gains]) == pytest.approx(scatter, rel=0.1)


def test_a_few_contacts_of_many_make_no_significant_gain(rng):
    size = rng.uniform(0.1, 0.3, (CONTACTS, 1)) * np.ones(DEPTHS)
    assert gain_of(sampled(0.8 * size), sampled(size), ALL, LABELS).significant
    # Three of 40 contacts a little nearer, and two as much farther off.
    few = np.ones((CONTACTS, 1))
    few[:3], few[3:5] = 0.8, 1.2
    gain = gain_of(sampled(few * size), sampled(size), ALL, LABELS)
    assert gain.mean > 0.0
    assert not gain.significant


def test_few_contacts_tell_little(rng):
    """The depths of one are no independent samples. Chance is not called significant more often with few contacts than
    with many: Student's t."""
    size = np.full((CONTACTS, DEPTHS), 0.2)
    assert not gain_of(sampled(0.5 * size), sampled(size), np.arange(DEPTHS), LABELS).significant
    for few in (2, 3, 5):
        changes = (1.0 + 0.1 * rng.standard_normal((CONTACTS, 1)) for _ in range(1000))
        gains = [gain_of(sampled(c * size), sampled(size), np.arange(few * DEPTHS), LABELS) for c in changes]
        # 2.3 % are meant; with 1,000 draws that has a standard error of 0.5.
        assert np.mean([gain.significant for gain in gains]) < 0.04, few
