"""Handle sparsity: each part of a body depends on near frames only, and far frames are lumped into near ones.

Far from a frame a body hardly depends on the motion of that frame: of the 16 frames of the hand of `examples/hand.toml`
a cell depends on 4, that is, is strained by 10 % or more when one of them alone rotates by a right angle, and a node on
6, that is, is displaced by a tenth of a millimetre. So a matrix B that gives a strain or a displacement B d, with d the
difference of the handle rows from rest, is stored for near frames only. A far frame is assumed to move with the near
frame nearest to it,

    B d = sum_h B_h d_h ~ sum_{h near} (B_h + sum_{k far, nearest to h} B_k) d_h.

Frames that move rigidly together have the same d, so a rigid motion of the body strains it exactly as before. The rows
of points, which have no rotation, are always kept.

Cells are grouped by their near frames, so that all products are with dense blocks. Two groups are merged where the
extra multiplications cost less than the overhead of a separate group.

On the Hand 13 groups take a tenth of the multiplications of B^T A B and a quarter of those of B d. At states of a
motion of its report this changes the forces on the handles by 0.9 % (1.2 % in the worst of them) and their Hessian by
0.2 %, where ten cells for each row, instead of forty, change the forces by 14 %; with the handles on springs, its
surface at rest differs by 2 to 11 micrometres (RMS). With thresholds of 1 % for cells and 0.03 % for parts, and nodes
that depend on every frame, it is 0.2 % of the forces and 1 micrometre, and a step with its correction takes a twelfth
longer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody

# A frame is far from a cell that it strains by less than this, when it alone rotates by a right angle and moves by the
# distance to the next frame.
_LEAST_STRAIN = 0.1
# The same for sums over a part of the body that are precomputed.
_LEAST_STRAIN_OF_PARTS = 0.01
# The same for the displacement of nodes, as a fraction of the size of the body.
_LEAST_DISPLACEMENT = 5e-4
# Overhead of a group, in multiplications.
_GROUP = 1e6


class CellGroup(NamedTuple):
    """cells: (m,); rows: (k,) the handle rows that they depend on, ascending."""

    cells: IntArray
    rows: IntArray


class HandleSparsity:
    """The near frames of the parts of one body."""

    def __init__(self, body: ReducedBody) -> None:
        self._body, self._motions = body, _motions(body)
        pivots = np.array([frame.pivot for frame in body.handles.frames]).reshape(-1, body.dim)
        self._apart = np.linalg.norm(pivots[:, None] - pivots, axis=2)

    def groups(self, B: Array) -> tuple[list[CellGroup], Array]:
        """Groups of the cells of the cubature, and B (m, s, n_rows*dim) by d with far frames lumped in every group.
        B: the same before lumping."""
        strained = B @ self._motions
        near_frames = self._near(np.square(strained).sum(axis=1), _LEAST_STRAIN)
        groups, lumped = self._grouped(near_frames), B.copy()
        for cells, near in groups:
            lumped[cells] = self.lumped(B[cells], near)
        return [CellGroup(cells, self.rows(near)) for cells, near in groups], lumped

    def sparsified(self, modes: Array) -> Array:
        """Modes (n, dim, n_rows*dim), displacements of n nodes by d, with far frames lumped at every node."""
        by_unknowns = np.square(modes @ self._motions).sum(axis=1)
        sets, of = np.unique(
            self._near(by_unknowns, _LEAST_DISPLACEMENT * self._body.mesh.size), axis=0, return_inverse=True
        )
        lumped = np.empty_like(modes)
        for number, near in enumerate(sets):
            same = of.ravel() == number
            lumped[same] = self.lumped(modes[same], near)
        return lumped

    def near_part(self, stiffness: Array, unit: float) -> BoolArray:
        """Which frames (n_frames,) are near a part of the body with stiffness (n_rows*dim, n_rows*dim) by d. unit: its
        stiffness at a strain of one."""
        energy = (self._motions * (stiffness @ self._motions)).sum(axis=0)
        return np.asarray(self._near(np.maximum(energy, 0.0)[None] / unit, _LEAST_STRAIN_OF_PARTS)[0])

    def lumped(self, B: Array, near: BoolArray) -> Array:
        """B (.., n_rows*dim) with the columns of every far frame added to those of the near frame nearest to it."""
        result, kept = B.copy(), np.flatnonzero(near)
        for far in np.flatnonzero(~near):
            into, removed = self._columns(kept[self._apart[far, kept].argmin()]), self._columns(far)
            result[..., into] += result[..., removed]
            result[..., removed] = 0.0
        return result

    def rows(self, near: BoolArray) -> IntArray:
        """(k,) the handle rows of all points and of the frames that are near (n_frames,)."""
        handles = self._body.handles
        frames = handles.n_points + np.arange(handles.n_rows - handles.n_points).reshape(
            len(near), handles.dim + 1
        )
        return np.concatenate([np.arange(handles.n_points), frames[near].ravel()]).astype(np.int64)

    def _near(self, squared: Array, least: float) -> BoolArray:
        """Which frames (m, n_frames) are near, at least one of them, from the squared effect (m, n_dofs) of each of
        the motions."""
        handles, dim = self._body.handles, self._body.dim
        others = self._apart + np.diag(np.full(len(handles.frames), np.inf))
        strained = np.empty((len(squared), len(handles.frames)))
        for frame, handle in enumerate(handles.frames):
            own = squared[:, handles.dofs_of(handle.name)]
            next_frame = others[frame].min()
            step = next_frame if np.isfinite(next_frame) else self._body.mesh.size
            strained[:, frame] = step * np.sqrt(own[:, :dim].sum(axis=1))
            strained[:, frame] += np.sqrt(own[:, dim:].sum(axis=1))
        if not handles.frames:
            return np.ones(strained.shape, dtype=bool)
        near = strained >= least
        near[np.arange(len(near)), strained.argmax(axis=1)] = True
        return np.asarray(near)

    def _grouped(self, near: BoolArray) -> list[tuple[IntArray, BoolArray]]:
        """Groups of cells (m,), ascending, and their near frames (n_frames,) together."""
        sets, of = np.unique(near, axis=0, return_inverse=True)
        cells = [np.flatnonzero(of.ravel() == number) for number in range(len(sets))]
        while len(cells) > 1:
            frames, counts = sets.sum(axis=1), np.array([len(own) for own in cells])
            alone = self._cost(frames, counts)
            union = (sets[:, None] | sets).sum(axis=2)
            gain = alone[:, None] + alone - self._cost(union, counts[:, None] + counts)
            np.fill_diagonal(gain, -np.inf)
            first, second = sorted(np.unravel_index(gain.argmax(), gain.shape))
            if gain[first, second] <= 0.0:
                break
            sets[first] |= sets[second]
            sets = np.delete(sets, second, axis=0)
            cells[first] = np.sort(np.r_[cells[first], cells.pop(second)])
        return list(zip(cells, sets, strict=True))

    def _cost(self, frames: Array, cells: Array) -> Array:
        """The cost of B^T A B with so many near frames and cells, in multiplications."""
        dim = self._body.dim
        columns = dim * (self._body.handles.n_points + (dim + 1) * frames)
        return np.asarray(dim**2 * cells * columns**2 + _GROUP)

    def _columns(self, frame: int) -> slice:
        """The columns of a frame in B."""
        dim, width = self._body.dim, (self._body.dim + 1) * self._body.dim
        start = self._body.handles.n_points * dim + frame * width
        return slice(start, start + width)


def _motions(body: ReducedBody) -> Array:
    """d (n_rows*dim, n_dofs) of unit displacements of points and frames, and of frames that turn by a right angle about
    each axis. Not of infinitesimal turns: nodes beside a bone are carried by it, so that L hardly answers to these, but
    it does to the squeeze that a finite turn of this bone is in the rows of another one."""
    handles, rest = body.handles, body.rest_rows
    result = handles.tangent(rest)
    for frame in handles.frames:
        for dof in range(handles.n_dofs)[handles.dofs_of(frame.name)][body.dim :]:
            turned = handles.retract(rest, 0.5 * np.pi * np.eye(handles.n_dofs)[dof])
            result[:, dof] = (turned - rest).ravel()
    return result
