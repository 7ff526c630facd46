"""A camera-based tactile sensor: what a camera behind a soft pad sees of its surface, and the force on it.

The camera is fixed to the rigid back of the pad, a frame of the body, and looks along the normal of the pad,
orthographically. So a rigid motion of the whole scene changes nothing. All that it sees is given in the frame of a side
of the pad at rest (`pad_side.py`):

    markers   u_k = sum_i W_ki R^T (x_i - t) - X_k         how far marker k, printed on the surface at X_k, has moved
    depth     -z of the surface of the deformed pad in the middle of a pixel: how far it lies below its plane at rest
    force     sum_j -f_j,  torque  sum_j (y_j - o) x (-f_j)    of all contact forces f_j on colliders at points y_j

with the pose (R, t) of the back, fitted to some of its nodes, and the middle o of the side. The surface is followed at
a grid of its points, one for each corner of a pixel, so that the cost does not grow with the mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.contact_force import resultant
from softprint.runtime.dynamics.state import StepResult
from softprint.runtime.errors import SoftprintError
from softprint.runtime.touch.pad_side import PadSide
from softprint.runtime.touch.raster_kernels import seen
from softprint.runtime.touch.sensor import Followed

# The share of a side that the camera sees if no field of view is given.
_FIELD = 0.9
# The surface is followed this many pixels beyond the picture, for what comes into it sideways.
_MARGIN = 4
_FRAME_NODES = 12  # of the back, that its pose is fitted to
_MOST = 4096  # pixels or markers along a side of a picture


@dataclass(frozen=True, eq=False)
class TactileImage:
    """What the camera sees at one time [s], in the frame of the side (`pad_side.py`).

    markers: (n, dim) [m] displacement of the markers, along the axes of the plane and, last, the normal; depth: (rows,
    columns), in 2D (columns,), [m] of the surface below its plane at rest, nan where there is none; force: (dim,) [N]
    and torque: (3,), in 2D (1,), [N m] about the middle of the side, of all colliders on the pad.
    """

    time: float
    markers: Array
    depth: Array
    force: Array
    torque: Array


class TactileCamera:
    """Looks at one side of a body that `source` simulates.

    side: the axis that it looks along, such as "+z", by default up; markers: how many along each axis of its plane,
    (columns, rows); image: likewise, of pixels; field: (dim-1,) [m] the size of the field of view about the middle of
    the side, by default the largest with square pixels on nine tenths of the side; frame: of the back, by default the
    nearest to the side; a body without frames is seen by a camera that stands still. Markers are spread over the field
    as pixels are, both row by row from the upper left: from the largest coordinate along the second axis.

    places: (n, dim-1) [m] the markers at rest, in the plane. Raises SoftprintError where side, field and frame are not
    of the body.
    """

    def __init__(
        self,
        source: Followed,
        body: ReducedBody,
        *,
        side: str | None = None,
        markers: Sequence[int] = (12, 9),
        image: Sequence[int] = (64, 48),
        field: Sequence[float] | None = None,
        frame: str | None = None,
    ) -> None:
        plane = body.dim - 1
        self.side = PadSide.of(body.mesh, side)
        counts = [_counts(given, plane, what) for given, what in ((markers, "markers"), (image, "pixels"))]
        self.field = _field(self.side, counts[1], field)
        self.places = _cells(self.field, counts[0])
        printed, on_side = self.side.surface(self.places)
        if not on_side.all():
            raise SoftprintError(
                f"{np.count_nonzero(~on_side)} of {len(on_side)} markers lie beside the surface: give a field of view "
                f"smaller than {' x '.join(f'{1e3 * size:.3g}' for size in self.field)} mm"
            )
        self._picture = _Picture(self.side, self.field, counts[1])
        back = _back(body, self.side, frame)
        used = (*(np.unique(m.indices) for m in (printed, self._picture.nodes)), back)
        watched = np.unique(np.concatenate(used)).astype(np.int64)
        self._positions: Callable[[Any], Array] = source.follow(watched)
        self._printed = printed[:, watched]
        self._picture.nodes = self._picture.nodes[:, watched]
        self._back = np.searchsorted(watched, back)
        self._back_rest = body.mesh.points[back]
        self._rest = self.side.coordinates(printed @ body.mesh.points)

    def see(self, result: StepResult[Any]) -> TactileImage:
        """What is seen after a step, or at the start of a scene."""
        x = self._positions(result.state)
        pose = (
            fitted_pose(self._back_rest, x[self._back]) if len(self._back) else RigidPose.identity(x.shape[1])
        )
        at = self.side.coordinates(pose.apply_inverse(x))
        parts = [part for contact in result.contacts.values() for part in contact.parts]
        force, torque = resultant(parts, pose.apply(self.side.origin[None])[0])
        axes = self.side.axes @ pose.rotation.T
        own_torque = torque if len(torque) == 1 else axes @ torque
        markers = self._printed @ at - self._rest
        return TactileImage(result.state.time, markers, self._picture.depth(at), -axes @ force, -own_torque)


class _Picture:
    """The grid of points of the surface that is drawn. nodes: (n, n_watched) its points as means over nodes."""

    def __init__(self, side: PadSide, field: Array, counts: IntArray) -> None:
        self.shape = (1, counts[0]) if len(counts) == 1 else (counts[1], counts[0])
        self._flat = len(counts) == 1
        self._upper_left = np.append(-0.5 * field[:1], 0.5 * field[1:])  # (column, row) axis by axis
        self._pixel = field / counts
        corners = counts + 1 + 2 * _MARGIN
        plane = _cells(self._pixel * corners, corners)
        self.nodes, on_side = side.surface(plane)
        columns = corners[0]
        rows = 1 if self._flat else corners[1]
        number = np.arange(len(plane)).reshape(rows, columns)
        if self._flat:  # a strip one pixel high
            number = np.vstack([number, number + columns])
            on_side = np.tile(on_side, 2)
        a, b, c, d = (
            corner.ravel() for corner in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
        )
        triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
        self.triangles = triangles[on_side[triangles].all(axis=1)]

    def depth(self, at: Array) -> Array:
        """(rows, columns), in 2D (columns,), with the watched nodes at these coordinates of the side (n, dim)."""
        points = self.nodes @ at
        place = (points[:, :-1] - self._upper_left) / self._pixel * [1.0, -1.0][: points.shape[1] - 1] - 0.5
        height = points[:, -1]
        if self._flat:
            place = np.column_stack([np.repeat([-0.5, 0.5], len(place)), np.tile(place[:, 0], 2)])
            height = np.tile(height, 2)
        else:
            place = place[:, ::-1]
        found, shares = seen(np.ascontiguousarray(place), height, self.triangles, *self.shape)
        depth = np.where(found < 0, np.nan, -(shares * height[self.triangles[found]]).sum(axis=-1))
        return np.asarray(depth[0] if self._flat else depth)


def fitted_pose(rest: Array, points: Array) -> RigidPose:
    """The rigid motion nearest to that of points (n, dim), from rest, by least squares (Kabsch 1976)."""
    middle, now = rest.mean(axis=0), points.mean(axis=0)
    left, _, right = np.linalg.svd((points - now).T @ (rest - middle))
    turned = np.ones(rest.shape[1])
    turned[-1] = np.sign(np.linalg.det(left @ right))
    rotation = (left * turned) @ right
    return RigidPose.known(rotation, now - rotation @ middle)


def _cells(field: Array, counts: IntArray) -> Array:
    """(n, dim-1) the middles of the cells of a field, row by row from the upper left."""
    steps = [
        size * ((np.arange(count) + 0.5) / count - 0.5) for size, count in zip(field, counts, strict=True)
    ]
    if len(steps) == 1:
        return steps[0][:, None]
    across, up = np.meshgrid(steps[0], steps[1][::-1])
    return np.column_stack([across.ravel(), up.ravel()])


def _counts(given: Sequence[int], plane: int, what: str) -> IntArray:
    counts = np.asarray(given)
    if (
        counts.shape != (plane,)
        or counts.dtype.kind not in "iu"
        or not ((counts > 0) & (counts <= _MOST)).all()
    ):
        raise SoftprintError(
            f"{what} {np.asarray(given).tolist()}: must be {plane} whole number(s) from 1 to {_MOST}, along the "
            "axes of the side"
        )
    return counts.astype(np.int64)


def _field(side: PadSide, counts: IntArray, given: Sequence[float] | None) -> Array:
    """(dim-1,) [m]."""
    extent = side.upper - side.lower
    if given is None:
        return np.asarray(_FIELD * (extent / counts).min() * counts)
    field = np.asarray(given, dtype=float)
    if field.shape != extent.shape or not ((field > 0) & (field <= extent * (1 + 1e-9))).all():
        raise SoftprintError(
            f"field of view {field.tolist()} m: must be {len(extent)} positive number(s), no larger than the side, "
            f"{' x '.join(f'{size:.4g}' for size in extent)} m"
        )
    return field


def _back(body: ReducedBody, side: PadSide, name: str | None) -> IntArray:
    """Some nodes of the frame that the camera is fixed to; none without frames."""
    frames = {frame.name: frame for frame in body.handles.frames}
    if name is not None and name not in frames:
        raise SoftprintError(f"the body has no frame {name!r}; its frames: {', '.join(frames) or 'none'}")
    if not frames:
        return np.empty(0, dtype=np.int64)
    points = body.mesh.points
    if name is None:
        name = min(
            frames,
            key=lambda own: float(np.linalg.norm(points[frames[own].nodes] - side.origin, axis=1).min()),
        )
    nodes = frames[name].nodes
    return np.sort(nodes[farthest_points(points[nodes], min(_FRAME_NODES, len(nodes)))])
