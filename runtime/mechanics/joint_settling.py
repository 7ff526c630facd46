"""What static condensation lacks where joints are bent: learned from states in equilibrium.

Between two rigid frames that have turned against each other the body settles by more than an answer that is linear in
the handle rows (`static_condensation.py`). At every node X, in the rotation R_X that condensation is turned by, it
lacks

    e_X = R_X^T (u_X - u_X of condensation) = sum_s alpha_Xs k(theta, theta_s),

with theta_j the rotation vectors of joints j at the frame rows, theta_s those of known states, and

    k(theta, theta') = sum_j theta_j . theta'_j + (theta_j . theta'_j)^2:

a polynomial of second order in the angles of each joint, and a sum over joints, which settle by themselves. At rest it
vanishes. Like the rotations, e is held in a time step: where the body is in equilibrium at its rows, its energy does
not change with e, and nor do forces on the handles.

A joint is a pair of frames; they are the edges of the shortest tree between all frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.rotations import nearest_rotations


@dataclass(frozen=True, eq=False)
class Joints:
    """pairs: (j, 2) frames, by their numbers; n_points: point handles, whose rows are before those of frames."""

    pairs: IntArray
    n_points: int

    @classmethod
    def of(cls, body: ReducedBody) -> Joints:
        """Between frames that are near each other; none in a body with fewer than two."""
        frames, points = body.handles.frames, body.mesh.points
        if len(frames) < 2:
            return cls(np.zeros((0, 2), dtype=np.int64), body.handles.n_points)
        trees = [cKDTree(points[frame.nodes]) for frame in frames]
        gaps = [[tree.query(points[frame.nodes])[0].min() for frame in frames] for tree in trees]
        tree = minimum_spanning_tree(csr_matrix(np.array(gaps)))
        return cls(np.sort(np.stack(tree.nonzero(), axis=1), axis=1).astype(np.int64), body.handles.n_points)

    def angles(self, rows: Array) -> Array:
        """theta (j, 1 or 3) [rad] at handle rows (n_rows, dim): by how much the second frame of each has turned, seen
        from the first."""
        dim = rows.shape[1]
        frames = rows[self.n_points :].reshape(-1, dim + 1, dim)[:, :dim]
        R = nearest_rotations(np.ascontiguousarray(frames.swapaxes(1, 2)))
        first, second = R[self.pairs[:, 0]], R[self.pairs[:, 1]]
        turned = first.swapaxes(1, 2) @ second
        if dim == 2:
            return np.asarray(np.arctan2(turned[:, 1, 0], turned[:, 0, 0])[:, None])
        return np.asarray(Rotation.from_matrix(turned).as_rotvec().reshape(-1, 3))


def kernel(theta: Array, others: Array) -> Array:
    """k (n, m) of angles (n, j, k) and (m, j, k)."""
    products = np.einsum("njk,mjk->nmj", theta, others)
    return np.asarray((products + products**2).sum(axis=2))


@dataclass(frozen=True, eq=False)
class JointSettling:
    """e of n nodes. angles: theta_s (s, j, k) [rad]; weights: alpha (n, dim, s) [m]."""

    joints: Joints
    angles: Array
    weights: NDArray[np.floating[Any]]

    @property
    def sizes(self) -> tuple[int, int, int]:
        """How many states, joints and nodes."""
        return len(self.angles), len(self.joints.pairs), len(self.weights)

    def at(self, nodes: IntArray) -> JointSettling:
        """That of some of the nodes, by index."""
        return replace(self, weights=self.weights[nodes])

    def displacement(self, frame_rows: Array) -> Array:
        """e (n, dim) [m] at frame rows (n_rows, dim)."""
        found = kernel(self.joints.angles(frame_rows)[None], self.angles)[0]
        return np.asarray(self.weights @ found.astype(self.weights.dtype), dtype=np.float64)
