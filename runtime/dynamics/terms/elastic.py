"""W_elastic of thesis eq. 5.5 on the cubature cells, at the corrected positions of their corners.

    E = sum_c w_c Psi(F_c),    F_c = D_c rows + sum_a u_a (x) G_ca,    B = dF/drows,
    gradient = sum_c w_c B^T P,    Hessian = sum_c w_c B^T A B.

The term in d2u/drows2 is left out of the Hessian (thesis 5.4); the gradient is exact.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np

from runtime.arrays import Array, RowHessian, known_hessian
from runtime.body.body import ReducedBody
from runtime.dynamics.corrected_points import CorrectedPoints
from runtime.elasticity.reduced_elasticity import ReducedElasticity
from runtime.learned.correction import CorrectionField


class Elastic(Protocol):
    """The elastic energy of a body; displacements and fields are those of the watched points, turn
    (n_rows, dim) is where an internal response is turned (`corotation.py`)."""

    def energy(self, rows: Array, turn: Array, displacement: Array | None) -> float:
        """E [J]; displacement: u (n, dim) [m]."""
        ...

    def linearise(
        self, rows: Array, turn: Array, field: CorrectionField | None
    ) -> tuple[float, Array, RowHessian]:
        """Energy [J], gradient (n_rows, dim) [N] and Hessian (n_rows*dim, n_rows*dim) [N/m] by the rows."""
        ...

    @property
    def products(self) -> int:
        """Multiplications that the Hessian takes."""
        ...


class ElasticEnergy:
    """Of U rows and the corrections at the watched points. There is nothing to turn."""

    def __init__(self, body: ReducedBody, points: CorrectedPoints) -> None:
        self._points = points
        self._elasticity = watched_elasticity(body, points)
        self._basis_derivative = self._elasticity.basis_derivative()
        m, n_rows, dim = self._elasticity.basis_gradient.shape
        self.products = m * dim**2 * (n_rows * dim) ** 2

    def energy(self, rows: Array, turn: Array, displacement: Array | None) -> float:
        """See `Elastic`."""
        return self._elasticity.energy(self._gradients(rows, displacement))

    def linearise(
        self, rows: Array, turn: Array, field: CorrectionField | None
    ) -> tuple[float, Array, RowHessian]:
        """See `Elastic`."""
        F = self._gradients(rows, self._points.scatter(field))
        energy = self._elasticity.energy(F)
        if field is None:
            gradient, second = self._elasticity.gradient(F), partial(self._elasticity.hessian, F)
        else:
            B = with_field(self._basis_derivative, self._elasticity, self._points, field)
            gradient = self._elasticity.general_gradient(F, B)
            second = partial(self._elasticity.general_hessian, F, B)
        return energy, gradient, lambda along=None: known_hessian(second())(along)

    def _gradients(self, rows: Array, displacement: Array | None) -> Array:
        F = self._elasticity.deformation_gradients(rows)
        return F if displacement is None else F + self._elasticity.correction_gradients(displacement)


def watched_elasticity(body: ReducedBody, points: CorrectedPoints) -> ReducedElasticity:
    """The body's cubature. Its corners count among the watched points: nothing here has the length of the mesh."""
    return replace(ReducedElasticity.of(body), corners=points.corners)


def with_field(
    derivative: Array, elasticity: ReducedElasticity, points: CorrectedPoints, field: CorrectionField
) -> Array:
    """B (m, dim, dim, n_rows, dim) + sum_a G_aj du_ai/drows."""
    dim = field.displacement.shape[1]
    corners = points.slots(field)[points.corners]
    touched = np.flatnonzero((corners >= 0).any(axis=1))
    jacobian = field.jacobian.reshape(len(field.index), -1)[corners[touched]]
    jacobian[corners[touched] < 0] = 0.0
    added = elasticity.hat_gradients[touched].transpose(0, 2, 1) @ jacobian  # (c, j, i.rk)
    B = derivative.copy()
    B[touched] += added.reshape(len(touched), dim, dim, *B.shape[3:]).transpose(0, 2, 1, 3, 4)
    return B
