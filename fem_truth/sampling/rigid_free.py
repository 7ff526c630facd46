"""The rigid-free configuration of a handle state: relative handle transformations over a graph (thesis
5.3.2).

The graph joins each handle to its nearest neighbours at rest; a spanning tree joins components that this leaves
separate. An edge (i, j) contributes the position of handle j relative to handle i in a corotated orientation (that of
the first frame, or without frames the best-fit rotation of all handles), and the rotation of any frame at its ends
relative to that orientation. All these numbers are invariant to a rigid motion of the whole state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import minimum_spanning_tree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.rotations import nearest_rotation

# An edge whose numbers vary by less than this share of its rest length is left out of distances.
_STILL = 1e-6


@dataclass(frozen=True, eq=False)
class RigidFreeDescriptor:
    """Maps handle rows to their rigid-free numbers; constructed by :meth:`of`.

    edges: (n_edges, 2) numbers of handles, points first; lengths: (n_edges,) at rest [m]; rest_positions:
    (n_handles, dim) of the handles [m].
    """

    handles: Handles
    edges: IntArray
    lengths: Array
    rest_positions: Array

    @classmethod
    def of(cls, body: ReducedBody) -> RigidFreeDescriptor:
        rest = _positions(body.handles, body.rest_rows)
        edges = _neighbour_graph(rest, neighbours=2 * body.dim)
        lengths = np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)
        return cls(body.handles, edges, lengths, rest)

    def edge_numbers(self, rows: Array) -> list[Array]:
        """The numbers of each edge: relative position over the rest length, then rotations of frames at its ends."""
        positions, rotations = _positions(self.handles, rows), _rotations(self.handles, rows)
        orientation = rotations[0] if rotations else self._best_fit(positions)
        relative = (
            (positions[self.edges[:, 1]] - positions[self.edges[:, 0]]) @ orientation / self.lengths[:, None]
        )
        numbers = []
        for edge, (i, j) in enumerate(self.edges):
            frames = [end - self.handles.n_points for end in (i, j) if end >= self.handles.n_points]
            turns = [(orientation.T @ rotations[frame]).ravel() for frame in frames]
            numbers.append(np.concatenate([relative[edge], *turns]))
        return numbers

    def normalised(self, states: Array) -> Array:
        """(n_states, n_numbers) descriptors of states (n_states, n_rows, dim), each edge scaled to unit
        variance.

        The numbers of one edge share one scale, so that an edge with little motion counts as much as one with a lot,
        and the proportions of its directions are kept.
        """
        table = [self.edge_numbers(rows) for rows in states]
        columns = []
        for edge in range(len(self.edges)):
            values = np.array([numbers[edge] for numbers in table])
            deviation = values - values.mean(axis=0)
            scale = np.sqrt(np.mean(np.sum(deviation**2, axis=1)))
            columns.append(deviation / scale if scale > _STILL else np.zeros_like(deviation))
        return np.concatenate(columns, axis=1)

    def _best_fit(self, positions: Array) -> Array:
        """R (dim, dim) that best fits the rest positions of the handles to the present ones (Kabsch)."""
        rest = self.rest_positions - self.rest_positions.mean(axis=0)
        return nearest_rotation((positions - positions.mean(axis=0)).T @ rest)


def _positions(handles: Handles, rows: Array) -> Array:
    """(n_handles, dim) positions of the handles: points first, then the pivots of the frames [m]."""
    pivots = [handles.position(rows, frame.name) for frame in handles.frames]
    return np.vstack([rows[: handles.n_points], *pivots])


def _rotations(handles: Handles, rows: Array) -> list[Array]:
    """R (dim, dim) of each frame; its rows hold R^T."""
    return [rows[handles.rows_of(frame.name)][:-1].T for frame in handles.frames]


def _neighbour_graph(positions: Array, neighbours: int) -> IntArray:
    distance = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    order = np.argsort(distance, axis=1, kind="stable")[:, 1 : neighbours + 1]
    pairs = {(int(i), int(j)) if i < j else (int(j), int(i)) for i in range(len(order)) for j in order[i]}
    tree = minimum_spanning_tree(csr_matrix(distance)).tocoo()
    pairs |= {(int(min(i, j)), int(max(i, j))) for i, j in zip(tree.row, tree.col, strict=True)}
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
