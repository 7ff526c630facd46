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
        centred = self._centred(rows)
        return np.asarray((centred @ nearest_rotation(rows.T @ self.gradient) - self.rest).ravel())

    def derivative(self, rows: Array) -> Array:
        """dz/drows (n_rows*dim, n_rows*dim).

        With F = R S, a change dF rotates R by dR = R W, where W S + S W = R^T dF - dF^T R.
        """
        n, dim = rows.shape
        centred, F = self._centred(rows), rows.T @ self.gradient
        R = nearest_rotation(F)
        S = R.T @ F
        mean = self.affine_part / self.affine_part.sum()
        direct = np.einsum("rs,bk->rksb", np.eye(n) - np.outer(self.affine_part, mean), R)
        generators = np.array([skew(axis) for axis in np.eye(rotation_dofs(dim))])
        # The change of R by drows_sb is dF = e_b (x) G_s; its skew part along each generator.
        towards = np.einsum("sj,bi->sbij", self.gradient, R)  # R^T dF
        skewed = np.einsum("gij,sbij->gsb", generators, towards - towards.swapaxes(2, 3)) / 2.0
        both = generators @ S + S @ generators
        stiffness = np.einsum("gij,hij->gh", generators, both) / 2.0
        turns = np.linalg.solve(stiffness, skewed.reshape(len(generators), -1)).reshape(skewed.shape)
        turned = np.einsum("ra,gak->rkg", centred @ R, generators)
        return np.asarray((direct + np.einsum("rkg,gsb->rksb", turned, turns)).reshape(n * dim, n * dim))

    def _centred(self, rows: Array) -> Array:
        return np.asarray(rows - np.outer(self.affine_part, self.affine_part @ rows / self.affine_part.sum()))
