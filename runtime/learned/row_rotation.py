"""A rotation of the body as a function of the handle rows, with its derivatives: R = polar(rows^T G).

With G the gradient of the basis averaged over the body it is the rotation of the whole; with G that picks the linear
rows of a frame, the rotation of the frame. With F = rows^T G = R S, a change dF rotates R by dR = R W, where
W S + S W = T - T^T and T = R^T dF. Along a second change dF',

    S' = T' - W' S,    d2R = R (W' W + X),    X S + S X = - W' T - T^T W' - W S' - S' W.
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


def mean_gradient(body: ReducedBody) -> Array:
    """G (n_rows, dim) [1/m]: the gradient of the basis, averaged over the volume of the body."""
    volumes = body.mesh.cell_volumes
    weights = np.einsum("c,caj->caj", volumes / volumes.sum(), body.mesh.cell_gradients)
    return np.asarray(np.einsum("caj,car->rj", weights, body.basis[body.mesh.cells]))


@dataclass(frozen=True, eq=False)
class RowRotation:
    """R at one state. gradient: G (n_rows, dim); R, S: (dim, dim)."""

    gradient: Array
    R: Array
    S: Array

    @classmethod
    def at(cls, gradient: Array, rows: Array) -> RowRotation:
        """At handle rows (n_rows, dim)."""
        F = rows.T @ gradient
        R = nearest_rotation(F)
        return cls(gradient, R, R.T @ F)

    @lazy
    def turns(self) -> Array:
        """W (n_rows*dim, dim, dim) of the change of every row along every axis."""
        T, E = self._towards, self._generators
        skewed = np.einsum("gij,nij->gn", E, T - T.swapaxes(1, 2)) / 2.0
        return np.einsum("gn,gij->nij", np.linalg.solve(self._stiffness, skewed), E)

    def pulled_back(self, A: Array) -> Array:
        """d(A : R)/drows (n_rows, dim) of a matrix A (dim, dim), without the turns."""
        E = self._generators
        V = np.tensordot(self._stress(A), E, axes=1)
        return np.asarray(self.gradient @ V.T @ self.R.T)

    def crossed(self, moved: Array) -> Array:
        """Of sum_s drows_s . R' m_s, with the change of R along the second index: (n_rows*dim, n_rows*dim); moved: m
        (n_rows, dim)."""
        size = moved.size
        cross = np.tensordot(moved, self.R @ self.turns, axes=(1, 2))
        return np.asarray(cross.transpose(0, 2, 1).reshape(size, size))

    def curvature(self, A: Array) -> Array:
        """d2(A : R)/drows2 (n_rows*dim, n_rows*dim) of a matrix A (dim, dim)."""
        W, T, N = self.turns, self._towards, self.R.T @ A
        size = len(W)
        # N : (W' W + X), with W' and S' over the rows of the result; N : X = V : (X S + S X).
        flat = W.reshape(size, -1)
        twice = flat @ (N @ W.swapaxes(1, 2)).reshape(size, -1).T
        V = np.tensordot(self._stress(A), self._generators, axes=1) / 2.0
        S = T - W @ self.S
        twice -= flat @ (V @ T.swapaxes(1, 2) + T @ V).reshape(size, -1).T
        twice -= S.reshape(size, -1) @ (W.swapaxes(1, 2) @ V + V @ W.swapaxes(1, 2)).reshape(size, -1).T
        return twice

    @lazy
    def _towards(self) -> Array:
        """T (n_rows*dim, dim, dim) of the change of every row along every axis: dF = e_b (x) G_s."""
        dim = len(self.R)
        every = self.gradient[:, None, None, :] * self.R[None, :, :, None]
        return every.reshape(-1, dim, dim)

    @lazy
    def _generators(self) -> Array:
        return _GENERATORS[len(self.R)]

    @lazy
    def _stiffness(self) -> Array:
        both = self._generators @ self.S + self.S @ self._generators
        return np.einsum("gij,hij->gh", self._generators, both) / 2.0

    def _stress(self, A: Array) -> Array:
        return np.linalg.solve(self._stiffness, np.einsum("gij,ij->g", self._generators, self.R.T @ A))
