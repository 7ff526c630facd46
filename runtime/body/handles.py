"""Handles: the degrees of freedom of the reduced model, and the tangent space in which Newton's method steps them.

The reduced state is stored as *handle rows* (n_rows, dim): first one row for each point handle (its
position), then dim+1 rows for each rigid frame: the dim rows of R^T, then the translation t, so that a rest point X of
the frame is at x = X R^T + t. Reduced positions are linear in the rows, x = U rows (thesis eq. 4.1 without r).

Frames are stepped in the tangent space of their pose (thesis 4.2.3): an increment is a translation u and a
world rotation vector w about the frame's *pivot*, the current centroid of its region,

    R' = exp(w) R,    p' = p + u,    p = X_pivot R^T + t.

Rotating about the pivot instead of the origin keeps u and w uncoupled in the mass matrix of the region.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.rotations import (
    frame_slopes,
    frame_tangents,
    moved_frames,
    nearest_rotation,
    rotation_dofs,
    skew,
)
from softprint.runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class FrameHandle:
    """A rigid region. nodes: (n,) indices, ascending; pivot: (dim,) rest centroid of the region [m]."""

    name: str
    nodes: IntArray
    pivot: Array


@dataclass(frozen=True, eq=False)
class Handles:
    """Point handles (node indices) and rigid frames. Points are addressed by number, frames by name."""

    dim: int
    points: IntArray
    frames: tuple[FrameHandle, ...]

    @property
    def n_points(self) -> int:
        return len(self.points)

    @property
    def n_rows(self) -> int:
        return self.n_points + len(self.frames) * (self.dim + 1)

    @property
    def n_dofs(self) -> int:
        """Minimal coordinates: dim a point, dim + dim(dim-1)/2 a frame."""
        return self.n_points * self.dim + len(self.frames) * (self.dim + rotation_dofs(self.dim))

    @property
    def frame_nodes(self) -> IntArray:
        """All nodes in the regions of frames, ascending."""
        return np.sort(
            np.concatenate([frame.nodes for frame in self.frames] or [np.empty(0, dtype=np.int64)])
        )

    def rows_of(self, handle: int | str) -> slice:
        """Rows of one handle: a point by number, a frame by name."""
        if isinstance(handle, str):
            start = self.n_points + self._frame_index(handle) * (self.dim + 1)
            return slice(start, start + self.dim + 1)
        return slice(self._point_index(handle), handle + 1)

    def dofs_of(self, handle: int | str) -> slice:
        """Minimal coordinates of one handle; a frame has its translation first, then its rotation vector."""
        if isinstance(handle, str):
            width = self.dim + rotation_dofs(self.dim)
            start = self.n_points * self.dim + self._frame_index(handle) * width
            return slice(start, start + width)
        return slice(self._point_index(handle) * self.dim, (handle + 1) * self.dim)

    def _frame_index(self, name: str) -> int:
        for index, frame in enumerate(self.frames):
            if frame.name == name:
                return index
        known = ", ".join(frame.name for frame in self.frames) or "none"
        raise SoftprintError(f"the body has no frame named {name!r}; its frames: {known}")

    def _point_index(self, number: int) -> int:
        if not 0 <= number < self.n_points:
            raise SoftprintError(
                f"the body has no point handle {number}; they are numbered 0 to {self.n_points - 1}"
            )
        return number

    @property
    def affine_part(self) -> Array:
        """(n_rows,) 1 for rows that are positions (points, frame translations), 0 for the linear rows of frames: a
        translation t moves rows by affine_part (x) t."""
        frame = np.append(np.zeros(self.dim), 1.0)
        return np.concatenate([np.ones(self.n_points), *([frame] * len(self.frames))])

    @property
    def linearised_frames(self) -> Array:
        """P (n_rows*dim, n_rows*dim): what a difference d of the rows from rest is when frames have turned by
        infinitesimal angles. Of the linear rows D of a frame it keeps (D - D^T) / 2, and of its translation what moves
        its pivot alike. So P d is a strain-free motion of every frame, with the sines of finite angles in the place of
        the angles; without P, their cosines would squeeze the frame. P is the identity on `tangent` at rest."""
        dim, identity = self.dim, np.eye(self.dim)
        result = np.eye(self.n_rows * dim)
        for index, frame in enumerate(self.frames):
            rows = self._frame_rows(index)
            block = np.zeros((dim + 1, dim, dim + 1, dim))
            block[:dim, :, :dim] = np.einsum("ik,jl->ijkl", identity, identity)
            block[:dim, :, :dim] -= np.einsum("il,jk->ijkl", identity, identity)
            block[dim, :, :dim] = np.einsum("k,jl->jkl", frame.pivot, identity)
            block[dim, :, :dim] += np.einsum("l,jk->jkl", frame.pivot, identity)
            block *= 0.5
            block[dim, :, dim] = identity
            dofs = slice(rows.start * dim, rows.stop * dim)
            result[dofs, dofs] = block.reshape((dim + 1) * dim, -1)
        return result

    def rest_rows(self, points: Array) -> Array:
        """(n_rows, dim) rows at rest, from the rest positions (n_nodes, dim) of the mesh's nodes."""
        frame = np.vstack([np.eye(self.dim), np.zeros(self.dim)])
        return np.vstack([points[self.points], *([frame] * len(self.frames))])

    def position(self, rows: Array, handle: int | str) -> Array:
        """(dim,) position of a point handle, or of a frame's pivot [m]."""
        block = rows[self.rows_of(handle)]
        if not isinstance(handle, str):
            return block[0]
        return self.frames[self._frame_index(handle)].pivot @ block[:-1] + block[-1]

    def with_frame(self, rows: Array, name: str, rotation: Array, translation: Array) -> Array:
        """Rows with the frame ``name`` at the pose x = rotation X + translation."""
        moved = rows.copy()
        moved[self.rows_of(name)] = np.vstack([rotation.T, translation])
        return moved

    def rigid(self, rows: Array) -> Array:
        """Rows whose frames are rigid: each affine frame is replaced by its nearest rotation, about its pivot.

        Rows that come from a projection of full positions are affine in general.
        """
        result = rows.copy()
        for index, frame in enumerate(self.frames):
            block = result[self._frame_rows(index)]
            pivot = frame.pivot @ block[:-1] + block[-1]
            block[:-1] = nearest_rotation(block[:-1])
            block[-1] = pivot - frame.pivot @ block[:-1]
        return result

    def check_rows(self, rows: Array, what: str = "rows") -> None:
        """Raise SoftprintError for rows of a wrong shape, not finite, or whose frames are not rotations."""
        if rows.shape != (self.n_rows, self.dim):
            raise SoftprintError(
                f"{what}: shape {rows.shape}, but this body has handle rows {(self.n_rows, self.dim)}"
            )
        if not np.isfinite(rows).all():
            raise SoftprintError(f"{what}: has numbers that are not finite")
        for index, frame in enumerate(self.frames):
            rotation = rows[self._frame_rows(index)][:-1]
            # 1e-6: far above the drift of many thousand float64 retractions, far below any real deformation.
            if np.abs(rotation @ rotation.T - np.eye(self.dim)).max() > 1e-6 or np.linalg.det(rotation) < 0:
                raise SoftprintError(
                    f"{what}: frame {frame.name!r} is not a rotation; Handles.rigid makes it one"
                )

    def _frame_rows(self, index: int) -> slice:
        start = self.n_points + index * (self.dim + 1)
        return slice(start, start + self.dim + 1)

    def tangent(self, rows: Array) -> Array:
        """T (n_rows*dim, n_dofs): d rows.ravel() = T v, to first order in the v of :meth:`retract`."""
        tangent, points = np.zeros((self.n_rows * self.dim, self.n_dofs)), self.n_points * self.dim
        tangent[range(points), range(points)] = 1.0
        tangent.ravel()[self._of_frames] = self._frame_tangents(rows).ravel()
        return tangent

    def pulled_back(self, rows: Array, gradient: Array) -> Array:
        """T^T dE/drows (n_dofs,) of a gradient (n_rows, dim), without T."""
        result, points = np.empty(self.n_dofs), self.n_points
        result[: points * self.dim] = gradient[:points].ravel()
        frames, slopes = (np.ascontiguousarray(self._frames_of(part)) for part in (rows, gradient))
        result[points * self.dim :] = frame_slopes(
            frames, self._pivots, slopes, _generators(self.dim)
        ).ravel()
        return result

    @cached_property
    def _of_frames(self) -> IntArray:
        """Indices of the entries of `_frame_tangents` in the flattened T."""
        points, height = self.n_points * self.dim, (self.dim + 1) * self.dim
        width, each = self.dim + rotation_dofs(self.dim), np.arange(len(self.frames))[:, None, None]
        row = points + each * height + np.arange(height)[:, None]
        column = points + each * width + np.arange(width)
        return np.asarray((row * self.n_dofs + column).ravel())

    def _frame_tangents(self, rows: Array) -> Array:
        """See `frame_tangents`."""
        frames = np.ascontiguousarray(self._frames_of(rows))
        return frame_tangents(frames, self._pivots, _generators(self.dim))

    def _frames_of(self, rows: Array) -> Array:
        """R^T and t (n_frames, dim+1, dim) of every frame."""
        return rows[self.n_points :].reshape(-1, self.dim + 1, self.dim)

    @cached_property
    def _pivots(self) -> Array:
        """(n_frames, dim)."""
        return np.array([frame.pivot for frame in self.frames]).reshape(-1, self.dim)

    def increment(self, rows: Array, change: Array) -> Array:
        """The v (n_dofs,) of :meth:`retract` nearest to a change of the rows (n_rows, dim), to first order: points take
        it in full, frames its rigid part."""
        points, flat = self.n_points * self.dim, change.ravel()
        frames = self._frame_tangents(rows)
        transposed = frames.transpose(0, 2, 1)
        moved = flat[points:].reshape(*frames.shape[:2], 1)
        rigid = np.linalg.solve(transposed @ frames, transposed @ moved)
        return np.concatenate([flat[:points], rigid.ravel()])

    def units(self, lever: float) -> Array:
        """(n_dofs,) scale that makes every entry of v a length when divided by it: 1 for lengths, 1/lever [1/m] for the
        rotations of frames."""
        units = np.ones(self.n_dofs)
        for frame in self.frames:
            units[self.dofs_of(frame.name)][-rotation_dofs(self.dim) :] = 1.0 / lever
        return units

    def retract(self, rows: Array, increment: Array) -> Array:
        """Rows after the increment v (n_dofs,) [m, rad]: points add it, frames take its exponential map."""
        result, points = rows.copy(), self.n_points * self.dim
        result[: self.n_points] += increment[:points].reshape(-1, self.dim)
        if self.frames:
            steps = increment[points:].reshape(len(self.frames), -1)
            frames = np.ascontiguousarray(self._frames_of(rows))
            result[self.n_points :] = moved_frames(frames, self._pivots, steps).reshape(-1, self.dim)
        return result

    def curvature(self, rows: Array, gradient: Array) -> Array:
        """(n_dofs, n_dofs): second derivative of the retraction at v = 0, contracted with dE/drows (n_rows,
        dim).

        With it Newton's Hessian T^T (d2E/drows2) T + curvature is exact. From exp(w)^T = I - W + W^2/2 and
        W^2 = w w^T - |w|^2 I in 3D, -w^2 I in 2D; M = R (dE/dR^T - X_pivot (x) dE/dt).
        """
        dim, spin, n_frames = self.dim, rotation_dofs(self.dim), len(self.frames)
        curvature = np.zeros((self.n_dofs, self.n_dofs))
        frames, slopes = self._frames_of(rows), self._frames_of(gradient)
        levered = slopes[:, :-1] - self._pivots[:, :, None] * slopes[:, -1:]
        moments = frames[:, :-1].transpose(0, 2, 1) @ levered
        of_rotations = -np.trace(moments, axis1=1, axis2=2)[:, None, None] * np.eye(spin)
        if dim == 3:
            of_rotations += 0.5 * (moments + moments.transpose(0, 2, 1))
        start, width, each = self.n_points * dim, dim + spin, np.arange(n_frames)
        by_frame = curvature[start:, start:].reshape(n_frames, width, n_frames, width)
        by_frame[each, dim:, each, dim:] = of_rotations
        curvature[start:, start:] = by_frame.reshape(n_frames * width, n_frames * width)
        return curvature


@cache
def _generators(dim: int) -> Array:
    """(spin, dim, dim): the skew matrices of the unit rotation vectors."""
    return np.array([skew(axis) for axis in np.eye(rotation_dofs(dim))])


def centred(rows: Array, affine_part: Array) -> Array:
    """Rows (n_rows, dim) less their mean translation, which causes no strain; far from the origin it would only add
    round-off. affine_part: see `Handles.affine_part`."""
    return np.asarray(rows - np.outer(affine_part, affine_part @ rows / affine_part.sum()))
