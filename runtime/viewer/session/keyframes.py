"""Few keyframes for a recorded path: the path through them is the recorded one within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders import KeyframedPath, RigidPose

ANGLE = 2e-3  # rad, the tolerance of rotations


def keyframes(times: Array, poses: Sequence[RigidPose], distance: float) -> IntArray:
    """Indices (k,) of the frames to keep, the first and the last among them: a `KeyframedPath` through these is nowhere
    farther than `distance` [m] and `ANGLE` from a recorded pose. times (n,) [s], increasing."""
    last = len(poses) - 1
    kept = np.unique([0, last])
    while True:
        off = _deviations(times, poses, kept, distance)
        # The worst frame between every two that are kept, where it is off.
        added = [
            low + 1 + int(np.argmax(off[low + 1 : high]))
            for low, high in pairwise(kept)
            if high > low + 1 and off[low + 1 : high].max() > 1.0
        ]
        if not added:
            return kept
        kept = np.unique([*kept, *added])


def rotation_vectors(poses: Sequence[RigidPose]) -> Array:
    """(n, 1) or (n, 3) [rad]; in 2D without jumps of a whole turn."""
    vectors = np.array([pose.rotation_vector for pose in poses])
    return np.unwrap(vectors, axis=0) if vectors.shape[1] == 1 else vectors


def path_of(times: Array, poses: Sequence[RigidPose], kept: IntArray) -> KeyframedPath:
    """The path through the kept poses."""
    positions = np.array([poses[k].translation for k in kept])
    return KeyframedPath(times[kept], positions, rotation_vectors(poses)[kept])


def _deviations(times: Array, poses: Sequence[RigidPose], kept: IntArray, distance: float) -> Array:
    """(n,) of the path through the kept frames from every frame, in tolerances."""
    path = path_of(times, poses, kept)
    off = np.zeros(len(poses))
    for k, pose in enumerate(poses):
        found = path.pose(float(times[k]))
        apart = float(np.linalg.norm(found.translation - pose.translation))
        turned = float(np.linalg.norm(found.compose(pose.inverse()).rotation_vector))
        off[k] = max(apart / distance, turned / ANGLE)
    return off
