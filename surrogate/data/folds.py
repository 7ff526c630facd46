"""Parts of the samples to learn from, each with samples to judge by that share neither state nor shape with it.

The folds of cross-validation, never by random row, because neighbouring samples are strongly correlated: a fold judges
by samples whose state *and* shape are in one group each, and learns from those with neither. With one shape or one
state only the other counts; with one of both, contacts are held out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import IntArray
from softprint.runtime.truth.truth_file import TruthData

FOLDS = 4


@dataclass(frozen=True, eq=False)
class Fold:
    """Positions of samples to learn from, and to judge by."""

    learn: IntArray
    judge: IntArray


def folds_of(truth: TruthData, samples: IntArray, seed: int, most: int = FOLDS) -> list[Fold]:
    """At most `most` folds of samples, rows (n,) of the truth file; none where all are of one contact."""
    contact = truth.samples["contact"][samples]
    by_state, by_shape = truth.sample_state[samples], truth.contacts["collider"][contact]
    several = [labels for labels in (by_state, by_shape) if len(np.unique(labels)) > 1] or [contact]
    count = min(most, *(len(np.unique(labels)) for labels in several))
    rng = np.random.default_rng(seed)
    groups = [_grouped(labels, count, rng) for labels in several]
    folds = []
    for k in range(count):
        learn = np.flatnonzero(np.all([group != k for group in groups], axis=0))
        judge = np.flatnonzero(np.all([group == k for group in groups], axis=0))
        if count > 1 and len(learn) and len(judge):
            folds.append(Fold(learn, judge))
    return folds


def _grouped(labels: IntArray, count: int, rng: np.random.Generator) -> IntArray:
    """The group (n,) of each label, of `count` groups with equally many labels each."""
    known, number = np.unique(labels, return_inverse=True)
    group = np.empty(len(known), dtype=np.int64)
    group[rng.permutation(len(known))] = np.arange(len(known)) % count
    return group[number]
