"""Samples of a truth file and frames of a motion as deformed bodies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.fields.deformed import Deformed
from softprint.runtime.scenes.motion_file import Motion
from softprint.runtime.truth.truth_file import TruthData
from softprint.runtime.truth.truth_schema import CONVERGED, STATUS_NAMES


def deformed_samples(
    truth: TruthData, body: ReducedBody, colliders: Mapping[str, Collider], samples: Sequence[int]
) -> Iterator[Deformed]:
    """The given samples one by one; SoftprintError for an invalid number, or for a sample without a solution."""
    for sample in samples:
        if not 0 <= sample < truth.n_samples:
            raise SoftprintError(
                f"{truth.path}: no sample {sample}; they are numbered 0 to {truth.n_samples - 1}"
            )
        status = int(truth.samples["status"][sample])
        if status != CONVERGED:
            raise SoftprintError(
                f"{truth.path}: sample {sample} has no solution to show ({STATUS_NAMES[status]}: "
                f"{truth.samples['reason'][sample]})"
            )
        state, contact = int(truth.sample_state[sample]), int(truth.samples["contact"][sample])
        name = truth.header.colliders[truth.contacts["collider"][contact]]
        displacement = truth.displacement(sample).astype(np.float64)
        internal = truth.internal(state)
        yield Deformed(
            label=f"sample_{sample:06d}",
            time=float(sample),
            positions=body.reduced_positions(truth.states["rows"][state]) + internal + displacement,
            colliders=[(_known(colliders, name, truth.path), truth.pose(sample))],
            node_values={"contact_displacement": displacement, "internal_displacement": internal},
        )


def deformed_frames(
    motion: Motion, colliders: Mapping[str, Collider], frames: Sequence[int]
) -> Iterator[Deformed]:
    """The given frames one by one; SoftprintError for an invalid number."""
    for frame in frames:
        positions = motion.positions(frame)  # raises for an invalid frame
        yield Deformed(
            label=f"frame_{frame:06d}",
            time=float(motion.times[frame]),
            positions=positions,
            colliders=[
                (_known(colliders, name, motion.path), track.poses[frame])
                for name, track in motion.colliders.items()
            ],
        )


def _known(colliders: Mapping[str, Collider], name: str, path: Path) -> Collider:
    if name not in colliders:
        known = ", ".join(colliders) or "none"
        raise SoftprintError(
            f"{path}: has contacts of a collider {name!r}, which is not in the experiment; its colliders: {known}"
        )
    return colliders[name]
