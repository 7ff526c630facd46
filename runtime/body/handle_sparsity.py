"""Which frames each part of a body feels, and by what the others are stood in for.

Far from a frame a body hardly knows how that frame moves: of the 16 frames of the hand of `examples/hand.toml` a cell
feels 4, that is, is strained by 10 % or more when one of them alone turns by a right angle, and a node 6, that is, is
moved by a tenth of a millimetre. So a matrix B that gives a strain or a displacement B d, d being by how much the
handle rows differ from where they would be at rest, is kept for near frames only. A far frame is taken to move with the
near one next to it,

    B d = sum_h B_h d_h ~ sum_{h near} (B_h + sum_{k far, next to h} B_k) d_h.

Frames that move as one have the same d, so whatever moves the body rigidly strains it exactly as before. The rows of
points, which do not know how they turn, are always kept.

Cells are put in groups that share their near frames, for what follows to be products of dense blocks: two groups become
one where the multiplications that this costs are fewer than a group of its own is worth.

On the Hand 13 groups take a tenth of the multiplications of B^T A B and a quarter of those of B d. At states of a
motion of its report that changes the forces on the handles by 0.9 % (1.2 % in the worst of them) and their Hessian by
0.2 %, where ten cells for each row, in place of forty, change the forces by 14 %; held by springs, its surface rests 2
to 11 micrometres (RMS) from where it does without. With 1 % for cells and 0.03 % for parts, and nodes that feel every
frame, it is 0.2 % of the forces and 1 micrometre, and a step with its correction takes a twelfth longer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.arrays import Array, BoolArray, IntArray
from runtime.body.body import ReducedBody

# A frame is far where it strains by less than this when it alone turns by a right angle and moves as far as the next
# frame is.
_FELT = 0.1
# The same for what is summed over a part of the body ahead of time.
_FELT_BY_PARTS = 0.01
# The same for what moves nodes, by this share of the size of the body.
_MOVED = 5e-4
# Multiplications that take as long as what every group costs beside them.
_GROUP = 1e6


class CellGroup(NamedTuple):
    """cells: (m,); rows: (k,) the handle rows that they feel, ascending."""

    cells: IntArray
    rows: IntArray


class HandleSparsity:
    """Of one body."""

    def __init__(self, body: ReducedBody) -> None:
        self._body, self._tangent = body, body.handles.tangent(body.rest_rows)
        pivots = np.array([frame.pivot for frame in body.handles.frames]).reshape(-1, body.dim)
        self._apart = np.linalg.norm(pivots[:, None] - pivots, axis=2)

    def groups(self, B: Array) -> tuple[list[CellGroup], Array]:
        """Groups of the cells of the cubature, and B (m, s, n_rows*dim) by d with far frames stood in for in every
        group; given without that."""
        strained = B @ self._tangent
        groups, stood_in = self._grouped(self._felt(np.square(strained).sum(axis=1), _FELT)), B.copy()
        for cells, near in groups:
            stood_in[cells] = self.stood_in(B[cells], near)
        return [CellGroup(cells, self.rows(near)) for cells, near in groups], stood_in

    def kept(self, moved: Array) -> Array:
        """moved (n, dim, n_rows*dim) by d, which moves n nodes, with far frames stood in for at every node."""
        by_unknowns = np.square(moved @ self._tangent).sum(axis=1)
        sets, of = np.unique(
            self._felt(by_unknowns, _MOVED * self._body.mesh.size), axis=0, return_inverse=True
        )
        stood_in = np.empty_like(moved)
        for number, near in enumerate(sets):
            alike = of.ravel() == number
            stood_in[alike] = self.stood_in(moved[alike], near)
        return stood_in

    def felt_by(self, stiffness: Array, unit: float) -> BoolArray:
        """Which frames (n_frames,) a part of the body feels, of stiffness (n_rows*dim, n_rows*dim) by d, `unit` where
        it is strained by one."""
        energy = (self._tangent * (stiffness @ self._tangent)).sum(axis=0)
        return np.asarray(self._felt(np.maximum(energy, 0.0)[None] / unit, _FELT_BY_PARTS)[0])

    def stood_in(self, B: Array, near: BoolArray) -> Array:
        """B (.., n_rows*dim) with the columns of frames that are far added to those that stand in for them."""
        result, kept = B.copy(), np.flatnonzero(near)
        for far in np.flatnonzero(~near):
            by, gone = self._columns(kept[self._apart[far, kept].argmin()]), self._columns(far)
            result[..., by] += result[..., gone]
            result[..., gone] = 0.0
        return result

    def rows(self, near: BoolArray) -> IntArray:
        """(k,) of all points and of the frames (n_frames,) that are near."""
        handles = self._body.handles
        frames = handles.n_points + np.arange(handles.n_rows - handles.n_points).reshape(
            len(near), handles.dim + 1
        )
        return np.concatenate([np.arange(handles.n_points), frames[near].ravel()]).astype(np.int64)

    def _felt(self, squared: Array, least: float) -> BoolArray:
        """Which frames (m, n_frames) are felt, one of them at least, with the squares (m, n_dofs) of what each
        coordinate does."""
        handles, dim = self._body.handles, self._body.dim
        others = self._apart + np.diag(np.full(len(handles.frames), np.inf))
        strained = np.empty((len(squared), len(handles.frames)))
        for frame, handle in enumerate(handles.frames):
            own = squared[:, handles.dofs_of(handle.name)]
            next_frame = others[frame].min()
            step = next_frame if np.isfinite(next_frame) else self._body.mesh.size
            strained[:, frame] = step * np.sqrt(own[:, :dim].sum(axis=1))
            strained[:, frame] += 0.5 * np.pi * np.sqrt(own[:, dim:].sum(axis=1))
        if not handles.frames:
            return np.ones(strained.shape, dtype=bool)
        felt = strained >= least
        felt[np.arange(len(felt)), strained.argmax(axis=1)] = True
        return np.asarray(felt)

    def _grouped(self, felt: BoolArray) -> list[tuple[IntArray, BoolArray]]:
        """Cells (m,), ascending, and the frames (n_frames,) that they feel together."""
        sets, of = np.unique(felt, axis=0, return_inverse=True)
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
        """Of B^T A B, with so many of both, in multiplications."""
        dim = self._body.dim
        columns = dim * (self._body.handles.n_points + (dim + 1) * frames)
        return np.asarray(dim**2 * cells * columns**2 + _GROUP)

    def _columns(self, frame: int) -> slice:
        """By rows and axes."""
        dim, width = self._body.dim, (self._body.dim + 1) * self._body.dim
        start = self._body.handles.n_points * dim + frame * width
        return slice(start, start + width)
