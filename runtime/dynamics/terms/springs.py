"""Springs that pull handles to targets: the grip of a user, a hand or a robot on the body.

A point handle, or the pivot of a frame or another point of it, at p is pulled to its target by
E = k/2 |p - target|^2; the orientation R of a frame by E = k_r/4 |R - R_target|_F^2 = k_r (1 - cos(angle between
them)). Both are quadratic in the handle rows, so all springs together are the quadratic form
1/2 tr(rows^T K rows) - tr(L^T rows) + constant, with K (n_rows, n_rows).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.handles import Handles
from softprint.runtime.colliders.path import KeyframedPath, KeyframedPaths
from softprint.runtime.compiled import summing
from softprint.runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class HandleSpring:
    """handle: a point by number or a frame by name; stiffness k [N/m]; target: a path; the point (or the frame's
    anchor) is pulled to its position [m, world]; rotation_stiffness k_r [N m/rad], frames only: the frame is also
    pulled to its rotation. anchor: (dim,) the point of the rest body at which a frame is pulled [m]; None: its
    pivot."""

    handle: int | str
    stiffness: float
    target: KeyframedPath
    rotation_stiffness: float = 0.0
    anchor: Array | None = None

    def __post_init__(self) -> None:
        if not (self.stiffness >= 0 and self.rotation_stiffness >= 0):
            raise SoftprintError(f"the spring on handle {self.handle!r} has a negative stiffness")
        if self.rotation_stiffness and not isinstance(self.handle, str):
            raise SoftprintError(
                f"the spring on point handle {self.handle} has a rotation stiffness, but only frames have a rotation"
            )


@dataclass(frozen=True, eq=False)
class PointSpring:
    """A spring on a material point of the body, such as one that a user has grabbed. weights: (n_rows,) with
    p = weights^T rows, a row of the subspace basis U or a mean of some; stiffness k [N/m]; target: a path; the point is
    pulled to its position [m, world]."""

    weights: Array
    stiffness: float
    target: KeyframedPath

    def __post_init__(self) -> None:
        if not (np.isfinite(self.stiffness) and self.stiffness >= 0):
            raise SoftprintError(
                f"the stiffness of a spring on a point must be positive, not {self.stiffness}"
            )


def check_spring(spring: object, handles: Handles) -> None:
    """Raises SoftprintError for what is no spring, and for one of another dimension or subspace than the handles."""
    if not isinstance(spring, HandleSpring | PointSpring):
        raise SoftprintError(f"a spring must be a HandleSpring or a PointSpring, not a {type(spring).__name__}")
    if spring.target.dim != handles.dim:
        raise SoftprintError(
            f"a spring pulls to a path in {spring.target.dim}D, and the body is {handles.dim}D: give a path in "
            f"{handles.dim}D"
        )
    if isinstance(spring, PointSpring) and np.shape(spring.weights) != (handles.n_rows,):
        raise SoftprintError(
            f"a spring on a point has weights of shape {np.shape(spring.weights)}, and the body has {handles.n_rows} "
            "handle rows: give the row of `body.basis` of the point"
        )
    if isinstance(spring, HandleSpring) and spring.anchor is not None and np.shape(spring.anchor) != (handles.dim,):
        raise SoftprintError(
            f"the anchor of the spring on {spring.handle!r} has shape {np.shape(spring.anchor)}: it is a point of the "
            f"rest body, of {handles.dim} numbers"
        )


@dataclass(frozen=True, eq=False)
class QuadraticForm:
    """1/2 tr(rows^T matrix rows) - tr(linear^T rows) + constant [J]; matrix (n_rows, n_rows) [N/m]
    symmetric."""

    matrix: Array
    linear: Array
    constant: float

    @classmethod
    def about(cls, matrix: Array, centre: Array) -> QuadraticForm:
        """1/2 tr((rows - centre)^T matrix (rows - centre))."""
        linear = matrix @ centre
        return cls(matrix, linear, 0.5 * float(np.vdot(centre, linear)))

    def energy(self, rows: Array) -> float:
        return _energy(self.matrix, self.linear, rows) + self.constant

    def gradient(self, rows: Array) -> Array:
        return self.matrix @ rows - self.linear


class Springs:
    """All springs of a body together."""

    def __init__(self, springs: Sequence[HandleSpring | PointSpring], handles: Handles) -> None:
        self._dim, n_rows = handles.dim, handles.n_rows
        self._targets = KeyframedPaths([spring.target for spring in springs])
        self._matrix = np.zeros((n_rows, n_rows))
        # For every spring, the weights of the rows in the position that it pulls, times its stiffness; and those of the
        # rows in R^T.
        self._position_weights = np.zeros((len(springs), n_rows))
        self._rotation_weights = np.zeros((len(springs), handles.dim, n_rows))
        for number, spring in enumerate(springs):
            if isinstance(spring, PointSpring):
                self._position_weights[number] = spring.stiffness * spring.weights
                self._matrix += spring.stiffness * np.outer(spring.weights, spring.weights)
                continue
            rows, weights = handles.rows_of(spring.handle), _position_weights(handles, spring)
            self._position_weights[number, rows] = spring.stiffness * weights
            self._matrix[rows, rows] += spring.stiffness * np.outer(weights, weights)
            if spring.rotation_stiffness:
                linear, half = np.arange(rows.start, rows.stop - 1), 0.5 * spring.rotation_stiffness
                self._matrix[linear, linear] += half
                self._rotation_weights[number, np.arange(handles.dim), linear] = half
        self._stiffness = np.array([spring.stiffness for spring in springs])
        turning = [spring.rotation_stiffness for spring in springs if isinstance(spring, HandleSpring)]
        self._constant = 0.25 * self._dim * sum(turning)

    def form(self, time: float) -> QuadraticForm:
        """The energy with their targets at ``time`` [s]."""
        dim = self._dim
        rotations, targets = self._targets.poses(time)
        rotations, targets = rotations.reshape(-1, dim, dim), targets.reshape(-1, dim)
        linear = self._position_weights.T @ targets
        by_rotation = self._rotation_weights.reshape(-1, len(linear))
        linear += by_rotation.T @ rotations.transpose(0, 2, 1).reshape(-1, dim)
        constant = self._constant + 0.5 * float(self._stiffness @ (targets**2).sum(axis=1))
        return QuadraticForm(self._matrix, linear, constant)


@summing
def _energy(matrix: Array, linear: Array, rows: Array) -> float:
    """1/2 tr(rows^T matrix rows) - tr(linear^T rows)."""
    n, dim = rows.shape
    total, along = 0.0, np.empty(dim)
    for r in range(n):
        along[:] = 0.0
        for s in range(n):
            share = matrix[r, s]
            for a in range(dim):
                along[a] += share * rows[s, a]
        for a in range(dim):
            total += rows[r, a] * (0.5 * along[a] - linear[r, a])
    return total


def _position_weights(handles: Handles, spring: HandleSpring) -> Array:
    """w with p = w^T (rows of the handle): 1 for a point, (anchor, 1) for a frame."""
    if not isinstance(spring.handle, str):
        return np.ones(1)
    frame = next(frame for frame in handles.frames if frame.name == spring.handle)
    return np.append(frame.pivot if spring.anchor is None else spring.anchor, 1.0)
