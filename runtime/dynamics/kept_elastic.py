"""The elastic energy with its Hessian kept while the body is strained much as it was when the Hessian was found.

The Hessian of all cubature cells costs more than all else of a step in the subspace, and changes little from one
iteration to the next, or from step to step: the tangent of a material changes by as much as the deformation gradient.
Newton's method takes only a direction from it. Energy and gradient are exact, and so is what it converges to; how fast
it converges is a matter of the Hessian of the contact far more than of this one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.arrays import Array, RowHessian, known_hessian
from runtime.corrections.correction import CorrectionField
from runtime.dynamics.elastic import Elastic
from runtime.elasticity.reduced_elasticity import ReducedElasticity

# By so much the deformation gradient may have changed (root mean square over the cells) before a new one is found.
_SAME = 0.01


class _Kept(NamedTuple):
    """F (m, dim, dim) of the cells and the Hessian (n_rows*dim, n_rows*dim), both in the turned frame."""

    F: Array
    hessian: Array


class KeptElastic:
    """An `Elastic` like another one, but for the Hessian; elasticity: of the same body, to tell how strained it is."""

    def __init__(self, elastic: Elastic, elasticity: ReducedElasticity) -> None:
        self._elastic, self._elasticity = elastic, elasticity
        self._share = elasticity.weights / elasticity.weights.sum()
        self._kept: _Kept | None = None

    def energy(self, rows: Array, turn: Array, displacement: Array | None) -> float:
        """See `Elastic`."""
        return self._elastic.energy(rows, turn, displacement)

    def linearise(
        self, rows: Array, turn: Array, field: CorrectionField | None
    ) -> tuple[float, Array, RowHessian]:
        """See `Elastic`. Where a field takes part, which moves cells otherwise in every state, nothing is kept."""
        energy, gradient, second = self._elastic.linearise(rows, turn, field)
        if field is not None:
            return energy, gradient, second

        def hessian(along: Array | None = None) -> Array:
            F, kept = self._elasticity.deformation_gradients(rows @ turn), self._kept
            if kept is None or self._share @ ((F - kept.F) ** 2).sum(axis=(1, 2)) > _SAME**2:
                self._kept = kept = _Kept(F, turned(second(), turn.T))
            return known_hessian(turned(kept.hessian, turn))(along)

        return energy, gradient, hessian


def turned(hessian: Array, turn: Array) -> Array:
    """(I (x) R) H (I (x) R^T) of H (n_rows*dim, n_rows*dim): from the turned frame to the world."""
    size, dim = len(hessian), len(turn)
    right = (hessian.reshape(-1, dim) @ turn.T).reshape(-1, dim, size)
    return np.asarray((turn @ right).reshape(size, size))
