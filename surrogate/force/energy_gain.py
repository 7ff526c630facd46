"""How much less error a learned energy leaves than linear mechanics on samples that it has not seen, and whether that
is significant: the standard error is by leaving out one contact after another (jackknife, Efron and Stein 1981), since
the depths of one contact are no independent samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.surrogate.force.sampled_contacts import Sampled

# The significance level: how often chance alone would give such a gain. Two standard errors, with many independent
# contacts.
_LEVEL = 0.023


class Gain(NamedTuple):
    """mean: by how much the sum of the errors of some kinds is smaller, and its standard error, infinite with fewer
    than two contacts; contacts: their number."""

    mean: float
    standard_error: float
    contacts: int

    @property
    def significant(self) -> bool:
        """By Student's t-test, one-sided, with one degree of freedom less than there are contacts."""
        if self.contacts < 2:
            return False
        return bool(self.mean > stdtrit(self.contacts - 1, 1.0 - _LEVEL) * self.standard_error)


def gain_of(learned: Sampled, mechanics: Sampled, samples: IntArray, labels: tuple[str, ...]) -> Gain:
    """Of an energy over mechanics, on those of the samples (n,) that both have."""
    both = np.intersect1d(np.intersect1d(learned.samples, mechanics.samples), samples)
    before, after = mechanics.among(both), learned.among(both)
    contacts = np.unique(before.contacts)
    n = len(contacts)
    # All contacts, and all but each.
    sets = np.vstack([np.full(n, True), ~np.eye(n, dtype=bool)])
    mean, *without = _errors(before, contacts, sets, labels) - _errors(after, contacts, sets, labels)
    error = np.sqrt((n - 1) / n * np.square(without - np.mean(without)).sum()) if n > 1 else np.inf
    return Gain(float(mean), float(error), n)


def _errors(sampled: Sampled, contacts: IntArray, sets: BoolArray, labels: tuple[str, ...]) -> Array:
    """sum_k sqrt(sum |r_k|^2 / sum |true_k|^2) (m,) over m sets of contacts (n,); sets: (m, n) which each has."""
    of, least = np.searchsorted(contacts, sampled.contacts), np.finfo(np.float64).tiny
    total = np.zeros(len(sets))
    for kind in labels:
        missed, true = (
            sets @ np.bincount(of, np.square(values).sum(axis=1), len(contacts))
            for values in (sampled.found[kind] - sampled.truth[kind], sampled.truth[kind])
        )
        total += np.sqrt(missed / np.maximum(true, least))
    return total
