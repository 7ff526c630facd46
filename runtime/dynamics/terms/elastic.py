"""W_elastic of thesis eq. 5.5 on the cubature cells, at the corrected positions of their corners.

    E = sum_c w_c Psi(F_c),    F_c = D_c rows + sum_a u_a (x) G_ca,    B = dF/drows,
    gradient = sum_c w_c B^T P,    Hessian = sum_c w_c B^T A B + sum_c w_c P : d2F/drows2.

The last term is that of internal corrections; those of colliders leave it out of the Hessian (thesis 5.4). The gradient
is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, RowHessian, known_hessian
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.corner_gradients import CornerGradients
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity
from softprint.runtime.lazy import lazy


class ElasticEvaluation(Protocol):
    """The elastic energy at one state."""

    @property
    def energy(self) -> float:
        """[J]."""
        ...

    @property
    def F(self) -> Array:
        """(m, dim, dim) of the cubature cells."""
        ...

    def linearise(self, field: CorrectionField | None) -> tuple[Array, RowHessian]:
        """Gradient (n_rows, dim) [N] and Hessian (n_rows*dim, n_rows*dim) [N/m] by the rows; field: displacements by
        field corrections with their Jacobians."""
        ...


class ElasticInFrame(Protocol):
    """The elastic energy of a body in the corotated frame of one step."""

    def evaluate(self, rows: Array, displacement: Array | None) -> ElasticEvaluation:
        """The energy at handle rows (n_rows, dim), with displacements u (n, dim) [m] of the `CorrectedPoints`."""
        ...

    def basis_along(self, directions: Array | None) -> NDArray[np.floating[Any]]:
        """B = dF/drows (m*dim*dim, k) without field corrections, along directions (n_rows*dim, k), by default every row
        and axis."""
        ...


class Elastic(Protocol):
    """The elastic energy of a body."""

    def in_frame(self, frame_rows: Array) -> ElasticInFrame:
        """The energy with the rotations of frame rows (n_rows, dim), see `corotation.py`."""
        ...

    @property
    def products(self) -> int:
        """The number of multiplications for the Hessian."""
        ...


class ElasticEnergy:
    """The energy at U rows and the corrections. It is the same in every frame."""

    def __init__(self, body: ReducedBody, points: CorrectedPoints) -> None:
        self.points = points
        self.elasticity = watched_elasticity(body, points)
        self.corners = CornerGradients(self.elasticity, points)
        self._along: tuple[Array, NDArray[np.float32]] | None = None
        m, n_rows, dim = self.elasticity.basis_gradient.shape
        self.products = m * dim**2 * (n_rows * dim) ** 2

    def in_frame(self, frame_rows: Array) -> ElasticEnergy:
        """See `Elastic`."""
        return self

    def basis_along(self, directions: Array | None) -> NDArray[np.float32]:
        """See `ElasticInFrame`. Along points B is the same at every state, and kept."""
        kept = self._along
        if kept is not None and directions is not None and np.array_equal(kept[0], directions):
            return kept[1]
        found = self.elasticity.basis_along(directions)
        if directions is not None:
            self._along = directions, found
        return found

    def evaluate(self, rows: Array, displacement: Array | None) -> CellElasticity:
        """See `ElasticInFrame`."""
        F = self.elasticity.deformation_gradients(rows)
        if displacement is not None:
            F = F + self.elasticity.correction_gradients(displacement)
        return CellElasticity(self, F)


@dataclass(frozen=True, eq=False)
class CellElasticity:
    """An `ElasticEvaluation` of cells with deformation gradients F (m, dim, dim)."""

    term: ElasticEnergy
    F: Array

    @lazy
    def energy(self) -> float:
        """See `ElasticEvaluation`."""
        return self.term.elasticity.energy(self.F)

    def linearise(self, field: CorrectionField | None) -> tuple[Array, RowHessian]:
        """See `ElasticEvaluation`."""
        elasticity, F = self.term.elasticity, self.F
        if field is None:
            second = partial(elasticity.hessian, F)
            return elasticity.gradient(F), lambda along=None: known_hessian(second())(along)
        stress = elasticity.weights[:, None, None] * elasticity.material.first_piola(F)
        forces = self.term.corners.forces(stress, field)
        own = elasticity.gradient_of(stress)

        def hessian(along: Array | None = None) -> Array:
            B = self.term.basis_along(along)
            return self.term.corners.hessian(F, B, field, forces, along)

        return own + field.pulled_back(forces), hessian


def watched_elasticity(body: ReducedBody, points: CorrectedPoints) -> ReducedElasticity:
    """The cubature of the body with its corners numbered in `CorrectedPoints`, so that no array has the length of the
    mesh."""
    return replace(body.reduced_elasticity, corners=points.corners)
