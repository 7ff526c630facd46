"""The reduced state of a full-space frame, and full-space equilibria that share it.

    q = (U_f^T U_f)^-1 U_f^T x_f,        f: the nodes outside the rigid frames,

so that U_f^T (x - U q)_f = 0, the very constraint of the ground truth (thesis 5.3.3). Nodes of rigid frames
are no unknowns of that constraint: they are where the frame is, in the full space and in every model. Were
they part of the projection, the frame would come out bent, the frame of the full-space motion would itself
violate the constraint of its own reduced state, and an error that has nothing to do with contact would be
charged to every model."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from fem_truth.constrained import ConstrainedProblem
from runtime.arrays import Array
from runtime.body.body import ReducedBody


class Projection:
    """Least squares over the free nodes of one body; frames follow the positions they are given."""

    def __init__(self, body: ReducedBody) -> None:
        self._body = body
        self._frames = body.handles.frame_nodes
        self._free = np.setdiff1d(np.arange(body.n_nodes), self._frames)
        self._basis = body.basis[self._free]
        self._gram = cho_factor(self._basis.T @ self._basis)

    def rows(self, positions: Array) -> Array:
        """q (n_rows, dim) of positions (n_nodes, dim)."""
        return np.asarray(cho_solve(self._gram, self._basis.T @ positions[self._free]))

    def reduced(self, rows: Array, positions: Array) -> Array:
        """U q (n_nodes, dim), the nodes of rigid frames where they are in `positions`."""
        reduced = self._body.reduced_positions(rows)
        reduced[self._frames] = positions[self._frames]
        return reduced


class FramesInPlace(ConstrainedProblem):
    """The constrained problem, except that the nodes of rigid frames stay where the starting positions have
    them.

    With q projected by `Projection`, the positions of a static full-space frame satisfy the constraint
    exactly, and are their own constrained equilibrium."""

    def constrained(self, rows: Array, x: Array) -> Array:
        placed = super().constrained(rows, x)
        frames = self.body.handles.frame_nodes
        placed[frames] = x[frames]
        return placed
