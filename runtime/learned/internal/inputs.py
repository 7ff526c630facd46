"""What the network of an internal correction reads: the handle rows, without the rigid motion of the body.

    z = (rows - a t) R - rest,    R = polar(rows^T G),

with t the mean translation of the rows, a their affine part (`Handles.affine_part`), G the gradient of the basis
averaged over the body, and rest the same rows at rest. A rigid motion x -> Q x + s takes rows to rows Q^T + a s and R
to Q R, and leaves z as it was. Of a body under gravity the network also reads d R, with d the direction of gravity: how
the body lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.handles import centred
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.row_rotation import RowRotation, mean_gradient


@dataclass(frozen=True, eq=False)
class RigidFreeRows:
    """rest: centred rows at rest (n_rows, dim); gradient: G (n_rows, dim) [1/m]; affine_part: a (n_rows,); down: d
    (dim,), empty without gravity."""

    rest: Array
    gradient: Array
    affine_part: Array
    down: Array

    @classmethod
    def of(cls, body: ReducedBody, gravity: Sequence[float] = ()) -> RigidFreeRows:
        """Those of a body; gravity: (dim,) [m/s^2], empty or zero without."""
        affine, rest = body.handles.affine_part, body.rest_rows
        strength = float(np.linalg.norm(gravity))
        down = np.asarray(gravity) / strength if strength else np.empty(0)
        return cls(rest - np.outer(affine, affine @ rest / affine.sum()), mean_gradient(body), affine, down)

    @property
    def n_inputs(self) -> int:
        """The length of z."""
        return self.rest.size + len(self.down)

    def __call__(self, rows: Array) -> Array:
        """z (n_inputs,) of handle rows (n_rows, dim)."""
        return self.at(rows).value

    @lazy
    def centring(self) -> Array:
        """The derivative of the centred rows by the rows, of one axis (n_rows, n_rows)."""
        affine = self.affine_part
        return np.eye(len(affine)) - np.outer(affine, affine / affine.sum())

    def at(self, rows: Array) -> RigidFreePoint:
        """z at handle rows (n_rows, dim), with its derivatives."""
        return RigidFreePoint(self, centred(rows, self.affine_part), RowRotation.at(self.gradient, rows))

    def derivative(self, rows: Array) -> Array:
        """dz/drows (n_inputs, n_rows*dim)."""
        return self.at(rows).derivative


@dataclass(frozen=True, eq=False)
class RigidFreePoint:
    """z at one state: centred rows C (n_rows, dim), and the rotation R of the body."""

    inputs: RigidFreeRows
    centred: Array
    rotation: RowRotation

    @property
    def value(self) -> Array:
        """z (n_inputs,)."""
        moved, down = self.centred @ self.rotation.R - self.inputs.rest, self.inputs.down
        return np.concatenate([moved.ravel(), down @ self.rotation.R]) if len(down) else moved.ravel()

    @lazy
    def derivative(self) -> Array:
        """dz/drows (n_inputs, n_rows*dim)."""
        (n, dim), R = self.centred.shape, self.rotation.R
        direct = self.inputs.centring[:, None, :, None] * R.T[None, :, None, :]
        turned = np.tensordot(self.centred @ R, self.rotation.turns, axes=(1, 1))  # (row, change, axis)
        of_rows = direct.reshape(n * dim, n * dim) + turned.swapaxes(1, 2).reshape(n * dim, n * dim)
        if not len(self.inputs.down):
            return np.asarray(of_rows)
        return np.vstack([of_rows, ((self.inputs.down @ R) @ self.rotation.turns).T])

    def pulled_back(self, along: Array) -> Array:
        """d(a . z)/drows (n_rows*dim,) of a direction a (n_inputs,), without the whole derivative."""
        a, A = self._parts(along)
        direct = self.inputs.centring.T @ a @ self.rotation.R.T
        return np.asarray((direct + self.rotation.pulled_back(A)).ravel())

    def curvature(self, along: Array) -> Array:
        """d2(a . z)/drows2 (n_rows*dim, n_rows*dim) of a direction a (n_inputs,)."""
        a, A = self._parts(along)
        # C along one change and R along the other, and R along both.
        cross = self.rotation.crossed(self.inputs.centring.T @ a)
        total = cross + cross.T + self.rotation.curvature(A)
        return np.asarray(0.5 * (total + total.T))

    def _parts(self, along: Array) -> tuple[Array, Array]:
        """The part of a direction that belongs to the rows (n_rows, dim), and A (dim, dim) with a . z = A : R and what
        does not depend on R."""
        a, down = along[: self.centred.size].reshape(self.centred.shape), self.inputs.down
        A: Array = self.centred.T @ a
        if len(down):
            A += np.outer(down, along[self.centred.size :])
        return a, A
