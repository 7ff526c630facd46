"""Samples of a truth shared out among the cores: those of one contact go to one worker, which has its warm starts.
Results are put back in the order in which one process goes through the samples, so that they are the same for any
number of workers."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import IntArray
from softprint.runtime.forked_workers import worker_count
from softprint.runtime.truth.truth_file import TruthData

# Fewer samples for each worker are not worth another process.
_WORTH = 50


def workers_for(truth: TruthData, samples: IntArray) -> int:
    """How many workers samples (n,) are worth."""
    contacts = len(np.unique(truth.samples["contact"][samples]))
    return worker_count(min(contacts, len(samples) // _WORTH))


def shares_of(truth: TruthData, samples: IntArray, count: int) -> list[IntArray]:
    """Samples (n,) for each worker, contact by contact."""
    _, contact = np.unique(truth.samples["contact"][samples], return_inverse=True)
    return [samples[contact % count == worker] for worker in range(count)]


def in_order(truth: TruthData, samples: IntArray) -> IntArray:
    """The permutation (n,) by which samples (n,) come collider by collider, and ascending."""
    collider = truth.contacts["collider"][truth.samples["contact"][samples]]
    return np.lexsort((samples, collider)).astype(np.int64)
