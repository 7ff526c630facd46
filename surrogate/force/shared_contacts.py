"""The contacts of samples of a truth, followed on several cores."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType

import numpy as np

from softprint.runtime.arrays import IntArray
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.forked_workers import ForkedWorkers
from softprint.runtime.truth.shared_samples import in_order, shares_of
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.force.sampled_contacts import Sampled, SampledContacts, TouchingSample


class SharedContacts:
    """`SampledContacts` on several cores; a context manager. count: the number of workers."""

    def __init__(self, contacts: SampledContacts, truth: TruthData, count: int) -> None:
        def work(
            part: tuple[IntArray, LearnedEnergy], progress: Callable[[int], None]
        ) -> list[TouchingSample]:
            return contacts.touching(*part, progress)

        self._truth, self._count = truth, count
        self._workers = ForkedWorkers(work, count)

    def at(self, samples: IntArray, learned: LearnedEnergy, progress: Callable[[int], None]) -> Sampled:
        """See `SampledContacts.at`."""
        parts = [(share, learned) for share in shares_of(self._truth, samples, self._count)]
        touching = [one for found in self._workers.map(parts, progress) for one in found]
        order = in_order(self._truth, np.array([one.sample for one in touching], dtype=np.int64))
        return Sampled.of([touching[k] for k in order], self._truth, len(samples))

    def __enter__(self) -> SharedContacts:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._workers.close()
