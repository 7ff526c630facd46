"""The samples of a truth file in which the reduced body touches: in no others is there a contact for a model to see."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol, TypeVar

from runtime.arrays import Array, IntArray
from runtime.colliders.pose import RigidPose
from runtime.learned.correction import FollowsContact
from runtime.truth.truth_file import TruthData

Seen = TypeVar("Seen", covariant=True)


class Probe(Protocol[Seen]):
    """Sees a contact, or None where there is none."""

    def measure(self, rows: Array, pose: RigidPose) -> Seen | None: ...


def touching_samples(
    truth: TruthData, samples: IntArray, probe: Probe[Seen], progress: Callable[[int], None] | None
) -> Iterator[tuple[int, Array, RigidPose, Seen]]:
    """(row of the truth file, handle rows, pose, what the probe sees) of those samples that touch, in their order.
    progress: called for every sample, touching or not."""
    for sample in map(int, samples):
        if progress is not None:
            progress(1)
        rows, pose = truth.states["rows"][truth.sample_state[sample]], truth.pose(sample)
        if isinstance(probe, FollowsContact):
            probe.begin()
            for before in truth.way(sample)[:-1]:
                probe.lead(rows, before)
        seen = probe.measure(rows, pose)
        if seen is not None:
            yield sample, rows, pose, seen
