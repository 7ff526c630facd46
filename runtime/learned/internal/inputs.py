"""What the network of an internal correction reads: the handle rows, without the rigid motion of the body.

    z = (rows - a t) R - rest,    R = polar(rows^T G),

with t the mean translation of the rows, a their affine part (`Handles.affine_part`), G the gradient of the basis
averaged over the body, and rest the same rows at rest. A rigid motion x -> Q x + s takes rows to rows Q^T + a s and R
to Q R, and leaves z as it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.rotations import nearest_rotation, rotation_dofs, skew
from softprint.runtime.lazy import lazy

# Skew matrices of the turns about every axis.
_GENERATORS = {dim: np.array([skew(axis) for axis in np.eye(rotation_dofs(dim))]) for dim in (2, 3)}


@dataclass(frozen=True, eq=False)
class RigidFreeRows:
    """rest: centred rows at rest (n_rows, dim); gradient: G (n_rows, dim) [1/m]; affine_part: a (n_rows,)."""

    rest: Array
    gradient: Array
    affine_part: Array

    @classmethod
    def of(cls, body: ReducedBody) -> RigidFreeRows:
        """Those of a body."""
        volumes = body.mesh.cell_volumes
        weights = np.einsum("c,caj->caj", volumes / volumes.sum(), body.mesh.cell_gradients)
        gradient = np.einsum("caj,car->rj", weights, body.basis[body.mesh.cells])
        affine = body.handles.affine_part
        rest = body.rest_rows
        return cls(rest - np.outer(affine, affine @ rest / affine.sum()), gradient, affine)

    def __call__(self, rows: Array) -> Array:
        """z (n_rows*dim,) of handle rows (n_rows, dim)."""
        return self.at(rows).value

    @lazy
    def centring(self) -> Array:
        """The derivative of the centred rows by the rows, of one axis (n_rows, n_rows)."""
        affine = self.affine_part
        return np.eye(len(affine)) - np.outer(affine, affine / affine.sum())

    def at(self, rows: Array) -> RigidFreePoint:
        """z at handle rows (n_rows, dim), with its derivatives."""
        F = rows.T @ self.gradient
        R = nearest_rotation(F)
        return RigidFreePoint(self, self._centred(rows), R, R.T @ F)

    def derivative(self, rows: Array) -> Array:
        """dz/drows (n_rows*dim, n_rows*dim)."""
        return self.at(rows).derivative

    def _centred(self, rows: Array) -> Array:
        return np.asarray(rows - np.outer(self.affine_part, self.affine_part @ rows / self.affine_part.sum()))


@dataclass(frozen=True, eq=False)
class RigidFreePoint:
    """z at one state: centred rows C (n_rows, dim), R and S (dim, dim) of F = R S.

    A change dF of F rotates R by dR = R W, where W S + S W = T - T^T and T = R^T dF. Along a second change dF',

        S' = T' - W' S,    d2R = R (W' W + X),    X S + S X = - W' T - T^T W' - W S' - S' W.
    """

    inputs: RigidFreeRows
    centred: Array
    R: Array
    S: Array

    @property
    def value(self) -> Array:
        """z (n_rows*dim,)."""
        return np.asarray((self.centred @ self.R - self.inputs.rest).ravel())

    @lazy
    def _towards(self) -> Array:
        """T (n_rows*dim, dim, dim) of the change of every row along every axis: dF = e_b (x) G_s."""
        dim = len(self.R)
        every = self.inputs.gradient[:, None, None, :] * self.R[None, :, :, None]
        return every.reshape(-1, dim, dim)

    @lazy
    def _generators(self) -> Array:
        return _GENERATORS[len(self.R)]

    @lazy
    def _stiffness(self) -> Array:
        both = self._generators @ self.S + self.S @ self._generators
        return np.einsum("gij,hij->gh", self._generators, both) / 2.0

    @lazy
    def _turns(self) -> Array:
        """W (n_rows*dim, dim, dim)."""
        T, E = self._towards, self._generators
        skewed = np.einsum("gij,nij->gn", E, T - T.swapaxes(1, 2)) / 2.0
        return np.einsum("gn,gij->nij", np.linalg.solve(self._stiffness, skewed), E)

    @lazy
    def derivative(self) -> Array:
        """dz/drows (n_rows*dim, n_rows*dim)."""
        n, dim = self.centred.shape
        direct = self._centring[:, None, :, None] * self.R.T[None, :, None, :]
        turned = np.tensordot(self.centred @ self.R, self._turns, axes=(1, 1))  # (row, change, axis)
        return np.asarray(direct.reshape(n * dim, n * dim) + turned.swapaxes(1, 2).reshape(n * dim, n * dim))

    @property
    def _centring(self) -> Array:
        """dC/drows of one axis (n_rows, n_rows)."""
        return self.inputs.centring

    def pulled_back(self, along: Array) -> Array:
        """d(a . z)/drows (n_rows*dim,) of a direction a (n_rows*dim,), without the whole derivative."""
        a, E = along.reshape(self.centred.shape), self._generators
        N = self.R.T @ (self.centred.T @ a)
        V = np.tensordot(np.linalg.solve(self._stiffness, np.einsum("gij,ij->g", E, N)), E, axes=1)
        turned = self.inputs.gradient @ V.T
        return np.asarray(((self._centring.T @ a + turned) @ self.R.T).ravel())

    def curvature(self, along: Array) -> Array:
        """d2(a . z)/drows2 (n_rows*dim, n_rows*dim) of a direction a (n_rows*dim,)."""
        n, dim = self.centred.shape
        size, a, W, T, R = n * dim, along.reshape(n, dim), self._turns, self._towards, self.R
        # C along one change, and R along the other.
        moved = self._centring.T @ a
        cross = np.tensordot(moved, R @ W, axes=(1, 2)).transpose(0, 2, 1).reshape(size, size)
        # R along both: N : (W' W + X), with W' and S' over the rows of the result; N : X = V : (X S + S X).
        N = R.T @ (self.centred.T @ a)
        flat = W.reshape(size, -1)
        twice = flat @ (N @ W.swapaxes(1, 2)).reshape(size, -1).T
        E = self._generators
        pulled = np.linalg.solve(self._stiffness, np.einsum("gij,ij->g", E, N))
        V = np.einsum("g,gij->ij", pulled, E) / 2.0
        S = T - W @ self.S
        twice -= flat @ (V @ T.swapaxes(1, 2) + T @ V).reshape(size, -1).T
        twice -= S.reshape(size, -1) @ (W.swapaxes(1, 2) @ V + V @ W.swapaxes(1, 2)).reshape(size, -1).T
        total = cross + cross.T + twice
        return np.asarray(0.5 * (total + total.T))
