"""Placement of handles: listed in the experiment or spread over the surface, and checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.body.handles import FrameHandle, Handles
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

if TYPE_CHECKING:
    from softprint.runtime.experiment import FrameSpec

# A region is in general position when its thinnest extent is at least this share of its widest (singular
# values).
_FLAT = 1e-3
# A given coordinate may be this far from the nearest node, as a share of the body's size.
_SNAP = 0.25


def in_box(points: Array, box: ArrayLike) -> BoolArray:
    """(n,) which points (n, dim) lie in the axis-aligned box [[lower], [upper]] [m], its faces included."""
    bounds = np.asarray(box, dtype=np.float64)
    dim = points.shape[1]
    if bounds.shape != (2, dim) or not (bounds[0] <= bounds[1]).all():
        raise SoftprintError(
            f"box {np.asarray(box).tolist()}: must be [lower corner, upper corner] of {dim} numbers each, "
            "no lower number above its upper one"
        )
    return np.asarray(((points >= bounds[0]) & (points <= bounds[1])).all(axis=1))


def near_segments(points: Array, segments: ArrayLike, radius: float) -> BoolArray:
    """(n,) which points (n, dim) lie within the radius of one of the segments (m, 2, dim) [m]."""
    lines = np.asarray(segments, dtype=np.float64)
    dim = points.shape[1]
    if lines.ndim != 3 or lines.shape[1:] != (2, dim):
        raise SoftprintError(
            f"segments {np.asarray(segments).tolist()}: must be a list of [start, end] of {dim} numbers each"
        )
    near = np.zeros(len(points), dtype=bool)
    for start, end in lines:
        along = end - start
        t = np.clip((points - start) @ along / max(along @ along, np.finfo(float).tiny), 0.0, 1.0)
        near |= np.linalg.norm(points - start - t[:, None] * along, axis=1) <= radius
    return near


def frames_of(mesh: Mesh, specs: Sequence[FrameSpec]) -> list[FrameHandle]:
    """The rigid frames that an experiment describes."""
    frames = []
    for spec in specs:
        if spec.box is not None:
            frames.append(frame_in_box(mesh, spec.name, spec.box))
        elif spec.segments is not None and spec.radius is not None:
            frames.append(frame_along(mesh, spec.name, spec.segments, spec.radius))
    return frames


def frame_in_box(mesh: Mesh, name: str, box: ArrayLike) -> FrameHandle:
    """The rigid frame ``name`` of all nodes in the box ``[[lower], [upper]]``, in metres.

    Raises SoftprintError if the nodes do not determine an affine map: too few, or all in one plane.
    """
    return _frame(mesh, name, in_box(mesh.points, box), f"box {np.asarray(box).tolist()}")


def frame_along(mesh: Mesh, name: str, segments: ArrayLike, radius: float) -> FrameHandle:
    """The rigid frame ``name`` of all nodes within the radius [m] of one of the segments (m, 2, dim): a bone.

    Raises SoftprintError as :func:`frame_in_box` does.
    """
    near = near_segments(mesh.points, segments, radius)
    return _frame(mesh, name, near, f"within {radius:g} m of its segments")


def _frame(mesh: Mesh, name: str, inside: BoolArray, region: str) -> FrameHandle:
    nodes = np.flatnonzero(inside)
    where = f"frame {name!r}, {region}"
    if len(nodes) == mesh.n_nodes:
        raise SoftprintError(
            f"{where}: contains every node of the body, so nothing can deform: make it smaller"
        )
    if not in_general_position(mesh.points[nodes]):
        lower, upper = mesh.points.min(axis=0).round(4).tolist(), mesh.points.max(axis=0).round(4).tolist()
        raise SoftprintError(
            f"{where}: its {len(nodes)} nodes do not span {mesh.dim} dimensions; make the region thick enough "
            f"to contain two layers of nodes (the body reaches from {lower} to {upper} m)"
        )
    return FrameHandle(name, nodes, mesh.points[nodes].mean(axis=0))


def in_general_position(points: Array) -> bool:
    """Whether the points (n, dim) span all dim dimensions well enough to determine an affine map."""
    if len(points) <= points.shape[1]:
        return False
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extents[-1] > _FLAT * extents[0])


def place_handles(
    mesh: Mesh, points: int | Sequence[Sequence[float]], frames: Sequence[FrameHandle] = ()
) -> Handles:
    """Handles of a body: frames, checked against each other, and points outside them.

    points: how many to spread over the surface by farthest point (the first is farthest from the frames, or
    from the centroid if there are none), or coordinates [m], each snapped to its nearest node.
    """
    taken = np.zeros(mesh.n_nodes, dtype=bool)
    for index, frame in enumerate(frames):
        if frame.name in {other.name for other in frames[:index]}:
            raise SoftprintError(
                f"handles: two frames are named {frame.name!r}; each needs a name of its own"
            )
        if taken[frame.nodes].any():
            raise SoftprintError(
                f"handles: frame {frame.name!r} shares nodes with another frame: their regions must not meet"
            )
        taken[frame.nodes] = True
    nodes = _spread(mesh, points, taken) if isinstance(points, int) else _snap(mesh, points, taken)
    handles = Handles(mesh.dim, nodes, tuple(frames))
    if not frames and not in_general_position(mesh.points[nodes]):
        raise SoftprintError(
            f"handles: {len(nodes)} points that do not span {mesh.dim} dimensions do not determine an affine motion: "
            f"add a frame, or "
            f"at least {mesh.dim + 1} points in general position"
        )
    return handles


def _spread(mesh: Mesh, count: int, taken: BoolArray) -> IntArray:
    free = mesh.surface_nodes[~taken[mesh.surface_nodes]]
    if count > len(free):
        raise SoftprintError(
            f"handles: {count} points asked for, but only {len(free)} surface nodes lie outside the frames"
        )
    distance = cKDTree(mesh.points[taken]).query(mesh.points[free])[0] if taken.any() else None
    return free[farthest_points(mesh.points[free], count, distance=distance)]


def _snap(mesh: Mesh, points: Sequence[Sequence[float]], taken: BoolArray) -> IntArray:
    wanted = np.asarray(points, dtype=np.float64).reshape(len(points), -1)
    if len(wanted) and wanted.shape[1] != mesh.dim:
        raise SoftprintError(
            f"handles: points have {wanted.shape[1]} coordinates each, the body lives in {mesh.dim}D"
        )
    wanted = wanted.reshape(-1, mesh.dim)
    distance, nodes = cKDTree(mesh.points).query(wanted)
    for number, (away, node) in enumerate(zip(distance, nodes, strict=True)):
        where = f"handles: point {number} at {wanted[number].tolist()}"
        if away > _SNAP * mesh.size:
            raise SoftprintError(
                f"{where} is {away:.3g} m from the nearest node of the body: are its units metres?"
            )
        if taken[node]:
            raise SoftprintError(
                f"{where} lies in a frame or coincides with another point: move it, or leave it out"
            )
        taken[node] = True
    return np.asarray(nodes, dtype=np.int64)
