"""How a displacement of the corners of the cubature cells changes their deformation gradients: dF = G u.

With a field correction u(rows) of the corners, B = dF/drows of the rest, and the stress P w of the cells,

    gradient = B^T P w + (du/drows)^T f,    f = G^T P w,
    Hessian = (B + G du/drows)^T w A (B + G du/drows) + f . d2u/drows2.

The gradient needs no Jacobian where the field knows its product with forces. The Hessian is in single precision: it
gives Newton's method a direction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import summing
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity

Floats = NDArray[np.floating[Any]]
Singles = NDArray[np.float32]


class CornerGradients:
    """elasticity: of the m cubature cells, with corners numbered as in points."""

    def __init__(self, elasticity: ReducedElasticity, points: CorrectedPoints) -> None:
        self._elasticity = elasticity
        gradients = elasticity.hat_gradients
        m, corners, dim = gradients.shape
        i, j = np.indices((dim, dim))
        row = np.arange(m)[:, None, None, None] * dim * dim + (i * dim + j)
        column = elasticity.corners[:, :, None, None] * dim + i
        values = np.broadcast_to(gradients[:, :, None, :], (m, corners, dim, dim))
        shape = (m * dim * dim, points.count * dim)
        entries = (
            values.ravel(),
            (np.broadcast_to(row, values.shape).ravel(), np.broadcast_to(column, values.shape).ravel()),
        )
        whole = sp.csr_matrix(entries, shape=shape)
        self._adjoint = whole.T.tocsr()
        self._gradients = gradients.astype(np.float32)
        self._dim, self._count = dim, points.count

    def forces(self, stress: Array, field: CorrectionField) -> Array:
        """f (k, dim) [N] at the points of a field, of the stress P w (m, dim, dim) of the cells."""
        every = (self._adjoint @ stress.ravel()).reshape(self._count, self._dim)
        return every if len(field.index) == self._count else every[field.index]

    def hessian(
        self, F: Array, B: Floats, field: CorrectionField, forces: Array, along: Array | None
    ) -> Array:
        """The Hessian at deformation gradients F (m, dim, dim), along directions or by the rows; B (m*dim*dim, k):
        dF/drows of the rest, along the same directions."""
        m, square = len(F), self._dim**2
        B = self.corrected(B, field, along)
        tangent = self._elasticity.material.tangent(F).reshape(m, square, square)
        weighted: Singles = (self._elasticity.weights[:, None, None] * tangent).astype(np.float32)
        size = B.shape[2]
        total = (B.reshape(-1, size).T @ _stressed(weighted, B).reshape(-1, size)).astype(np.float64)
        bent = field.curvature(forces, along)
        return total if bent is None else total + bent

    def corrected(self, B: Floats, field: CorrectionField, along: Array | None) -> Singles:
        """B + G du/drows (m, dim*dim, k), see `hessian`."""
        rest = np.ascontiguousarray(B, dtype=np.float32).reshape(-1, self._dim**2, B.shape[1])
        J = np.ascontiguousarray(self._everywhere(field, along)).reshape(self._count, self._dim, -1)
        return _moved_corners(rest, J, self._elasticity.corners, self._gradients)

    def _everywhere(self, field: CorrectionField, along: Array | None) -> NDArray[np.float32]:
        """du/drows (n*dim, k) of all points, zero where the field is inactive."""
        J = field.along(along).astype(np.float32, copy=False)
        if len(field.index) == self._count:
            return J
        every = np.zeros((self._count, self._dim, J.shape[1]), dtype=np.float32)
        every[field.index] = J.reshape(-1, self._dim, J.shape[1])
        return every.reshape(-1, J.shape[1])


def _dense_moved_corners(B: Singles, J: Singles, corners: IntArray, gradients: Singles) -> Singles:
    return B + np.einsum("caik,caj->cijk", J[corners], gradients).reshape(B.shape)


@summing(reference=_dense_moved_corners)
def _moved_corners(B: Singles, J: Singles, corners: IntArray, gradients: Singles) -> Singles:
    """B + G J (m, dim*dim, k) of J (n, dim, k) at the nodes, for cells with corners (m, dim+1) and the gradients (m,
    dim+1, dim) of their shape functions."""
    dim, size = J.shape[1], J.shape[2]
    total = B.copy()
    for c in range(len(corners)):
        for a in range(corners.shape[1]):
            for i in range(dim):
                own = J[corners[c, a], i]
                for j in range(dim):
                    share, into = gradients[c, a, j], total[c, i * dim + j]
                    for k in range(size):
                        into[k] += share * own[k]
    return total


@summing(reference=lambda A, B: A @ B)
def _stressed(A: Singles, B: Singles) -> Singles:
    """A_c B_c (m, s, k) of A (m, s, s) and B (m, s, k)."""
    total = np.zeros_like(B)
    for c in range(len(A)):
        for i in range(A.shape[1]):
            into = total[c, i]
            for j in range(A.shape[2]):
                share, own = A[c, i, j], B[c, j]
                for k in range(len(own)):
                    into[k] += share * own[k]
    return total
