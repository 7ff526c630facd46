"""What the network of an object-centric correction reads: the collider relative to the handles, A(q)^-1 z (thesis
4.3.1).

With c the place of the collider and Q its rotation, p_h = P_h rows the place of handle h (a point, or the pivot of a
frame), and R_h the rotation of its frame,

    z = ((c - p_h) R_h of every handle,  R_f^T Q of every frame,  further parameters of the collider).

A point has the rotation of the frame that is nearest at rest; without frames all have the mean rotation of the body. A
rigid motion of body and collider leaves z as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.row_rotation import RowRotation, mean_gradient

# Further parameters of a collider, by name, as functions of the collider.
PARAMETERS = {"size": lambda collider: collider.size}


def parameters_of(collider: Collider, names: Sequence[str]) -> Array:
    """The values (n,) of some of the `PARAMETERS`."""
    return np.array([PARAMETERS[name](collider) for name in names])


@dataclass(frozen=True, eq=False)
class InteractionState:
    """places: P (n_handles, n_rows); gradients: (n_axes, n_rows, dim) of the rotations (`RowRotation`); axes:
    (n_handles,) which of them each handle has."""

    places: Array
    gradients: Array
    axes: IntArray

    @classmethod
    def of(cls, body: ReducedBody) -> InteractionState:
        """Those of a body."""
        handles, dim, n_rows = body.handles, body.dim, body.n_rows
        n_points, frames = handles.n_points, handles.frames
        places = np.zeros((n_points + len(frames), n_rows))
        places[range(n_points), range(n_points)] = 1.0
        if not frames:
            return cls(places, mean_gradient(body)[None], np.zeros(n_points, dtype=np.int64))
        gradients = np.zeros((len(frames), n_rows, dim))
        for number, frame in enumerate(frames):
            own = handles.rows_of(frame.name)
            places[n_points + number, own] = np.append(frame.pivot, 1.0)
            gradients[number, own] = np.vstack([np.eye(dim), np.zeros(dim)])
        pivots = np.array([frame.pivot for frame in frames])
        away = np.linalg.norm(body.mesh.points[handles.points][:, None] - pivots, axis=2)
        return cls(places, gradients, np.concatenate([away.argmin(axis=1), np.arange(len(frames))]))

    def n_inputs(self, parameters: int) -> int:
        """The length of z with so many parameters."""
        dim = self.gradients.shape[2]
        return len(self.places) * dim + len(self.gradients) * dim * dim + parameters

    def seen(self, pose: RigidPose, parameters: Array) -> SeenCollider:
        """Of one collider at a pose."""
        return SeenCollider(self, pose, parameters)


@dataclass(frozen=True, eq=False)
class SeenCollider:
    """z of one collider as a function of the handle rows. parameters: (n,) at the end of z."""

    state: InteractionState
    pose: RigidPose
    parameters: Array

    def __call__(self, rows: Array) -> Array:
        """z (n_inputs,) at handle rows (n_rows, dim)."""
        return self.at(rows).value

    def at(self, rows: Array) -> InteractionPoint:
        """z with its derivatives."""
        rotations = [RowRotation.at(gradient, rows) for gradient in self.state.gradients]
        return InteractionPoint(self, self.pose.translation - self.state.places @ rows, rotations)


@dataclass(frozen=True, eq=False)
class InteractionPoint:
    """z at one state. away: c - p_h (n_handles, dim); rotations: of the axes."""

    seen: SeenCollider
    away: Array
    rotations: Sequence[RowRotation]

    @lazy
    def value(self) -> Array:
        """z (n_inputs,)."""
        R = np.array([own.R for own in self.rotations])
        places = np.einsum("hb,hbi->hi", self.away, R[self.seen.state.axes])
        turned = R.swapaxes(1, 2) @ self.seen.pose.rotation
        return np.concatenate([places.ravel(), turned.ravel(), self.seen.parameters])

    @lazy
    def derivative(self) -> Array:
        """dz/drows (n_inputs, n_rows*dim); the parameters do not depend on the rows."""
        state, Q = self.seen.state, self.seen.pose.rotation
        (n_handles, n_rows), dim = state.places.shape, self.away.shape[1]
        R = np.array([own.R for own in self.rotations])
        W = np.array([own.turns for own in self.rotations])
        moved = -np.einsum("hs,hbi->hisb", state.places, R[state.axes]).reshape(n_handles, dim, -1)
        local = np.einsum("hb,hbi->hi", self.away, R[state.axes])
        moved += np.einsum("hj,hkji->hik", local, W[state.axes])
        turned = np.einsum("fkji,fjl->filk", W, R.swapaxes(1, 2) @ Q)
        return np.concatenate(
            [
                moved.reshape(-1, n_rows * dim),
                turned.reshape(-1, n_rows * dim),
                np.zeros((len(self.seen.parameters), n_rows * dim)),
            ]
        )

    def pulled_back(self, along: Array) -> Array:
        """d(a . z)/drows (n_rows*dim,) of a direction a (n_inputs,), without the whole derivative."""
        state = self.seen.state
        places, turned = self._parts(along)
        total = np.zeros((state.places.shape[1], self.away.shape[1]))
        for number, rotation in enumerate(self.rotations):
            own = state.axes == number
            total -= state.places[own].T @ (places[own] @ rotation.R.T)
            total += rotation.pulled_back(self._of_rotation(own, places, turned[number]))
        return total.ravel()

    def curvature(self, along: Array) -> Array:
        """d2(a . z)/drows2 (n_rows*dim, n_rows*dim) of a direction a (n_inputs,)."""
        state, (places, turned) = self.seen.state, self._parts(along)
        size = state.places.shape[1] * self.away.shape[1]
        total = np.zeros((size, size))
        for number, rotation in enumerate(self.rotations):
            own = state.axes == number
            # Places along one change and the rotation along the other, and the rotation along both.
            cross = rotation.crossed(-state.places[own].T @ places[own])
            total += cross + cross.T
            total += rotation.curvature(self._of_rotation(own, places, turned[number]))
        return 0.5 * (total + total.T)

    def _parts(self, along: Array) -> tuple[Array, Array]:
        """The parts of a direction that belong to places (n_handles, dim) and to rotations (n_axes, dim, dim)."""
        n_handles, dim = self.away.shape
        places, rest = along[: n_handles * dim], along[n_handles * dim :]
        turned = rest[: len(self.rotations) * dim * dim]
        return places.reshape(n_handles, dim), turned.reshape(-1, dim, dim)

    def _of_rotation(self, own: Array, places: Array, turned: Array) -> Array:
        """A (dim, dim) with a . z = A : R + what does not depend on R."""
        return np.asarray(self.away[own].T @ places[own] + self.seen.pose.rotation @ turned.T)
