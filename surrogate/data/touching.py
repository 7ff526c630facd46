"""The samples of a truth file in which the reduced body touches the collider: in all others, a model has no contact to
evaluate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar, runtime_checkable

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.truth.truth_file import TruthData

Seen = TypeVar("Seen", covariant=True)


class Probe(Protocol[Seen]):
    """Measures a contact; None if there is none."""

    def measure(self, rows: Array, pose: RigidPose) -> Seen | None: ...


@runtime_checkable
class FollowingProbe(Protocol[Seen]):
    """Follows a contact along its approach path: of several equilibria, it measures the one the path leads to."""

    def measure_along(self, rows: Array, poses: Sequence[RigidPose]) -> Seen | None: ...


def touching_samples(
    truth: TruthData, samples: IntArray, probe: Probe[Seen], progress: Callable[[int], None] | None
) -> Iterator[tuple[int, Array, RigidPose, Seen]]:
    """(row of the truth file, handle rows, pose, measurement of the probe) of the samples in contact, in order.
    progress: called for every sample, in contact or not."""
    for sample in map(int, samples):
        if progress is not None:
            progress(1)
        rows, pose = truth.states["rows"][truth.sample_state[sample]], truth.pose(sample)
        if isinstance(probe, FollowingProbe):
            seen = probe.measure_along(rows, truth.approach_path(sample))
        else:
            seen = probe.measure(rows, pose)
        if seen is not None:
            yield sample, rows, pose, seen
