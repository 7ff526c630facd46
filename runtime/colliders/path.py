"""Keyframed motion of a collider or of a kinematic handle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from softprint.runtime.arrays import Array
from softprint.runtime.body.rotations import rotated_by, rotation_exponential
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.compiled import compiled
from softprint.runtime.errors import SoftprintError


class KeyframedPath:
    """A rigid pose over time, given at keyframes and constant before the first and after the last of them.

    Positions follow a monotone cubic (Fritsch and Carlson), which is C1 and never overshoots a keyframe, so a collider
    whose last keyframe is at the surface does not dip into it. Rotations in 3D follow the shortest arc (slerp) between
    keyframes; the angle in 2D follows the same monotone cubic, so full revolutions are kept.

    times: (k,) [s], strictly increasing; positions: (k, dim) [m]; rotation_vectors: (k,) or (k, 1) angles in
    2D, (k, 3) axis times angle in 3D [rad], None for no rotation. Raises SoftprintError for anything else.
    """

    def __init__(
        self, times: ArrayLike, positions: ArrayLike, rotation_vectors: ArrayLike | None = None
    ) -> None:
        self.times: Array = np.atleast_1d(np.asarray(times, dtype=float))
        self.positions: Array = np.asarray(positions, dtype=float)
        count = self.times.size
        if self.positions.shape not in ((count, 2), (count, 3)):
            raise SoftprintError(
                f"a path with {count} keyframe(s) needs positions of shape ({count}, 2) or ({count}, 3), "
                f"not {self.positions.shape}"
            )
        columns = 1 if self.dim == 2 else 3
        rotations = (
            np.zeros((count, columns))
            if rotation_vectors is None
            else np.asarray(rotation_vectors, dtype=float)
        )
        if rotations.size != count * columns:
            wanted = "one angle" if self.dim == 2 else "axis times angle, three numbers,"
            raise SoftprintError(
                f"each of the {count} keyframe(s) of a {self.dim}D path needs {wanted} as its rotation; "
                f"got an array of shape {rotations.shape}"
            )
        self.rotation_vectors: Array = rotations.reshape(count, columns)
        if count == 0 or not all(
            np.isfinite(a).all() for a in (self.times, self.positions, self.rotation_vectors)
        ):
            raise SoftprintError(
                "a path needs at least one keyframe, with finite times, positions and rotations"
            )
        if (np.diff(self.times) <= 0).any():
            raise SoftprintError(f"keyframe times must increase strictly; got {self.times.tolist()}")
        self._constant = count == 1
        self._first = RigidPose.from_rotation_vector(self.rotation_vectors[0], self.positions[0])
        if not self._constant:
            self._position = PchipInterpolator(self.times, self.positions)
            if self.dim == 2:
                self._angle = PchipInterpolator(self.times, self.rotation_vectors)
            else:
                at_keys = Rotation.from_rotvec(self.rotation_vectors)
                self._rotations, self._spins = (
                    at_keys.as_matrix(),
                    (at_keys[:-1].inv() * at_keys[1:]).as_rotvec(),
                )

    @classmethod
    def constant(cls, pose: RigidPose) -> KeyframedPath:
        """A path that stays at one pose."""
        return cls([0.0], pose.translation[None], pose.rotation_vector[None])

    @property
    def dim(self) -> int:
        return int(self.positions.shape[1])

    @property
    def duration(self) -> float:
        """Time from the first keyframe to the last [s]."""
        return float(self.times[-1] - self.times[0])

    def pose(self, time: float) -> RigidPose:
        """The pose at `time` [s]; the first or last keyframe's outside the keyframed interval."""
        if self._constant:
            return self._first
        if self.dim == 2:
            t = float(np.clip(time, self.times[0], self.times[-1]))
            return RigidPose.from_rotation_vector(self._angle(t), self._position(t))
        # Not by scipy, whose overhead per call adds up when each handle of a body follows its own path.
        k, position, spin = _along(self.times, self._position.c, self._spins, float(time))
        return RigidPose.known(self._rotations[k] @ rotation_exponential(spin), position)


def _along_reference(times: Array, cubics: Array, spins: Array, time: float) -> tuple[int, Array, Array]:
    t = np.clip(time, times[0], times[-1])
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    return k, np.polyval(cubics[:, k], t - times[k]), (t - times[k]) / np.diff(times)[k] * spins[k]


@compiled(reference=_along_reference)
def _along(times: Array, cubics: Array, spins: Array, time: float) -> tuple[int, Array, Array]:
    """The interval of the k keyframes that a time lies in, the position (3,) by the cubics (4, k-1, 3), and the
    rotation vector since the interval's start, a part of its spin (k-1, 3)."""
    t = min(max(time, times[0]), times[-1])
    k = min(np.searchsorted(times, t, side="right"), len(times) - 1) - 1
    since = t - times[k]
    position = ((cubics[0, k] * since + cubics[1, k]) * since + cubics[2, k]) * since + cubics[3, k]
    return k, position, since / (times[k + 1] - times[k]) * spins[k]


class KeyframedPaths:
    """Several paths of one body, evaluated together, such as one for each bone of a hand."""

    def __init__(self, paths: Sequence[KeyframedPath]) -> None:
        self._paths = tuple(paths)
        # The fast path: all in 3D with the same keyframe times, as recorded motions have.
        self._together = bool(paths) and all(
            path.dim == 3 and not path._constant and np.array_equal(path.times, paths[0].times)
            for path in paths
        )
        if self._together:
            self._times = paths[0].times
            self._cubics = np.stack([path._position.c for path in paths])
            self._spins = np.stack([path._spins for path in paths])
            self._rotations = np.stack([path._rotations for path in paths])

    def poses(self, time: float) -> tuple[Array, Array]:
        """Rotations (n, dim, dim) and positions (n, dim) [m] at `time` [s]."""
        if self._together:
            begin, positions, partial_spins = _all_along(
                self._times, self._cubics, self._spins, self._rotations, float(time)
            )
            return rotated_by(begin, partial_spins), positions
        poses = [path.pose(time) for path in self._paths]
        return np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses])


def _all_along_reference(
    times: Array, cubics: Array, spins: Array, rotations: Array, time: float
) -> tuple[Array, Array, Array]:
    pieces = [_along_reference(times, *path, time) for path in zip(cubics, spins)]
    k, positions, partial_spins = zip(*pieces)
    return rotations[:, k[0]], np.array(positions), np.array(partial_spins)


@compiled(reference=_all_along_reference)
def _all_along(
    times: Array, cubics: Array, spins: Array, rotations: Array, time: float
) -> tuple[Array, Array, Array]:
    """`_along` for n paths: cubics (n, 4, k-1, 3), spins (n, k-1, 3), rotations (n, k, 3, 3). Returns the rotations at
    the start of the interval (n, 3, 3), the positions (n, 3) and the rotation vectors since then (n, 3)."""
    n = len(rotations)
    begin, positions, partial_spins = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    for path in range(n):
        k, positions[path], partial_spins[path] = _along(times, cubics[path], spins[path], time)
        begin[path] = rotations[path, k]
    return begin, positions, partial_spins
