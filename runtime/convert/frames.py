"""A motion as frames of a surface, one at a time: the one source of all formats.

In 3D the surface is the body's skin, in 2D the body itself, flat. Colliders are rigid: one surface each, and a pose in
every frame. Two frames of the motion are in memory at a time, whatever its length.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.level_set import collider_surface
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.convert.colouring import NONE, Colouring, colouring_of
from softprint.runtime.convert.recorded import Recorded
from softprint.runtime.convert.sampling import Sampling
from softprint.runtime.errors import SoftprintError
from softprint.runtime.lazy import lazy

# Grid cells along the longest side of a collider without a surface of its own: enough to look round.
_COLLIDER_CELLS = {2: 120, 3: 40}
# Frames a second of a single frame, which has no rate.
_ONE_FRAME = 30.0


@dataclass(frozen=True, eq=False)
class Frame:
    """time [s]; positions (n_nodes, dim) [m]; points (s, dim) of the surface; poses of the colliders, by name; values
    (s,) to colour by."""

    time: float
    positions: Array
    points: Array
    poses: Mapping[str, RigidPose]
    values: Array | None = None


@dataclass(frozen=True, eq=False)
class Extent:
    """What all frames lie in: outermost (m, dim) [m], points of body and colliders that are farthest out in one frame;
    middles (dim,) of the colliders, by name, averaged over the frames; top: the highest value to colour by."""

    outermost: Array
    middles: Mapping[str, Array]
    top: float


@dataclass(frozen=True, eq=False)
class SurfaceMotion:
    """What is converted. times: (n,) [s]; nodes: (s,) of the mesh that are on the surface; triangles: (t, 3) of it, by
    their number there; outline: (o, 2) segments in 2D, empty in 3D; solids: vertices (v, dim) and facets (f, dim) of
    the bounded colliders in their own coordinates, by name; colouring: None for plain."""

    source: Recorded
    times: Array
    nodes: IntArray
    triangles: IntArray
    outline: IntArray
    solids: Mapping[str, tuple[Array, IntArray]]
    colouring: Colouring | None

    def __len__(self) -> int:
        return len(self.times)

    @property
    def dim(self) -> int:
        return self.source.rest.dim

    @property
    def rate(self) -> float:
        """Frames a second, on average."""
        if len(self) == 1:
            return _ONE_FRAME
        return float((len(self) - 1) / (self.times[-1] - self.times[0]))

    @lazy
    def rest(self) -> Array:
        """(s, dim) [m]."""
        return self.source.rest.points[self.nodes]

    def frames(self, chosen: Sequence[int] | None = None) -> Iterator[Frame]:
        """All frames, or the chosen ones, in order."""
        reader = _Reader(self.source)
        for number in range(len(self)) if chosen is None else chosen:
            time = float(self.times[number])
            positions, poses = reader.at(time)
            values = None
            if self.colouring is not None:
                values = self.colouring.values(positions, poses)[self.nodes]
            shown = {name: poses[name] for name in self.solids}
            yield Frame(time, positions, positions[self.nodes], shown, values)

    @lazy
    def extent(self) -> Extent:
        """Reads every frame once."""
        outermost, top, towards = [], 0.0, _directions(self.dim)
        middles = {name: np.zeros(self.dim) for name in self.solids}
        for frame in self.frames():
            outermost.append(_farthest(frame.points, towards))
            for name, pose in frame.poses.items():
                vertices = self.solids[name][0]
                outermost.append(pose.apply(_farthest(vertices, pose.rotate_inverse(towards))))
                middles[name] += outermost[-1].mean(axis=0) / len(self)
            top = top if frame.values is None else max(top, float(frame.values.max()))
        return Extent(np.concatenate(outermost), middles, top)


def surface_motion(
    source: Recorded, sampling: Sampling | None = None, colour: str = NONE, with_colliders: bool = True
) -> SurfaceMotion:
    """The frames of a motion that are asked for. with_colliders: whether they are in the frames.

    Raises SoftprintError where the motion has no such frames, or a collider cannot be built.
    """
    rest = source.rest
    times = (sampling or Sampling()).times(source.times, source.label)
    colliders = source.build_colliders() if with_colliders else {}
    if rest.dim == 3:
        nodes = rest.surface_nodes
        triangles, outline = np.searchsorted(nodes, rest.facets), np.zeros((0, 2), dtype=np.int64)
    else:
        nodes, triangles, outline = np.arange(rest.n_nodes), rest.cells, rest.facets
    solids = {
        name: surface_of(collider)
        for name, collider in colliders.items()
        if name in source.poses() and np.isfinite(collider.upper - collider.lower).all()
    }
    colouring = colouring_of(colour, source, colliders)
    return SurfaceMotion(source, times, nodes, triangles, outline, solids, colouring)


def surface_of(collider: Collider) -> tuple[Array, IntArray]:
    """Vertices (v, dim) [m] and facets (f, dim): those of the collider's own file if it has one, or else the zero level
    of its distance."""
    if isinstance(collider, GridCollider):
        return collider.vertices, np.asarray(collider.facets, dtype=np.int64)
    return collider_surface(collider, _COLLIDER_CELLS[collider.dim])


def in_space(points: Array) -> Array:
    """(n, 3): points in 2D lie in the plane z = 0."""
    return points if points.shape[1] == 3 else np.pad(points, ((0, 0), (0, 1)))


def pose_in_space(pose: RigidPose) -> RigidPose:
    """In 3D: a pose in 2D turns about z."""
    if pose.dim == 3:
        return pose
    rotation = np.eye(3)
    rotation[:2, :2] = pose.rotation
    return RigidPose.known(rotation, np.append(pose.translation, 0.0))


def _directions(dim: int) -> Array:
    """(3^dim - 1, dim) towards the sides, edges and corners of a box."""
    steps = np.indices((3,) * dim).reshape(dim, -1).T - 1.0
    return steps[steps.any(axis=1)]


def _farthest(points: Array, directions: Array) -> Array:
    """(d, dim) the point that is farthest out in each direction (d, dim)."""
    return points[np.argmax(points @ directions.T, axis=0)]


class _Reader:
    """Reads a motion at any time in between its frames, of which it keeps the last two."""

    def __init__(self, source: Recorded) -> None:
        self._source, self._times, self._poses = source, source.times, source.poses()
        self._kept: dict[int, Array] = {}

    def at(self, time: float) -> tuple[Array, Mapping[str, RigidPose]]:
        """Positions (n_nodes, dim) on the straight line between two frames, and poses at constant velocity."""
        earlier = int(np.clip(np.searchsorted(self._times, time, side="right") - 1, 0, len(self._times) - 1))
        later = min(earlier + 1, len(self._times) - 1)
        step = self._times[later] - self._times[earlier]
        share = float(np.clip((time - self._times[earlier]) / step, 0.0, 1.0)) if step > 0 else 0.0
        if min(share, 1.0 - share) < 1e-6:  # a frame of the motion itself
            frame = later if share > 0.5 else earlier
            return self._read(frame), {name: poses[frame] for name, poses in self._poses.items()}
        positions = (1.0 - share) * self._read(earlier) + share * self._read(later)
        poses = {name: poses[earlier].towards(poses[later], share) for name, poses in self._poses.items()}
        return positions, poses

    def _read(self, frame: int) -> Array:
        if frame not in self._kept:
            self._kept = {number: kept for number, kept in self._kept.items() if abs(number - frame) == 1}
            self._kept[frame] = positions = self._source.positions(frame)
            if not np.isfinite(positions).all():
                raise SoftprintError(
                    f"{self._source.label}: frame {frame} has positions that are no numbers, because the "
                    "simulation broke down: convert the frames before it with --to"
                )
        return self._kept[frame]
