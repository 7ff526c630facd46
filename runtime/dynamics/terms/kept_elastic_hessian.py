"""The elastic energy with its Hessian kept while the body is strained much as it was when the Hessian was found.

With many handles the Hessian of all cubature cells costs more than all else of a step in the subspace, and it changes
little from one iteration to the next, or from step to step: the tangent of a material changes by as much as the
deformation gradient. Newton's method takes only a direction from it; energy and gradient are exact, and so is what it
converges to. What is kept is the Hessian along the directions that were asked for, the coordinates of points and
frames: they turn with the body, so that their meaning changes no more than its strain. Along the motion of the hand of
`examples/hand.toml` this takes 3.1 iterations a step in place of 3.0 in the bare subspace, and three fifths of the time
(medians); under a correction, whose Hessian is of near frames only, 2.1 in place of 2.0 and nine tenths.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array, RowHessian
from runtime.dynamics.terms.elastic import Elastic
from runtime.elasticity.reduced_elasticity import ReducedElasticity
from runtime.learned.correction import CorrectionField

# By so much the deformation gradient may have changed (root mean square over the cells) before a new one is found.
_SAME = 0.03
# Hessians of fewer multiplications are found sooner than the iterations take that a kept one may cost.
_DEAR = 1e7


def kept_if_dear(elastic: Elastic, elasticity: ReducedElasticity) -> Elastic:
    """The elastic energy of a body, with its Hessian kept where it takes long to find."""
    return KeptElasticHessian(elastic, elasticity) if elastic.products > _DEAR else elastic


class KeptElasticHessian:
    """An `Elastic` like another one, but for the Hessian; elasticity: of the same body, to tell how strained it is."""

    def __init__(self, elastic: Elastic, elasticity: ReducedElasticity) -> None:
        self._elastic, self._elasticity = elastic, elasticity
        self._share = elasticity.weights / elasticity.weights.sum()
        # F (m, dim, dim) of the cells and the Hessian there, along so many directions.
        self._kept: tuple[Array, int, Array] | None = None

    def energy(self, rows: Array, turn: Array, displacement: Array | None) -> float:
        """See `Elastic`."""
        return self._elastic.energy(rows, turn, displacement)

    @property
    def products(self) -> int:
        """See `Elastic`."""
        return self._elastic.products

    def linearise(
        self, rows: Array, turn: Array, field: CorrectionField | None
    ) -> tuple[float, Array, RowHessian]:
        """See `Elastic`. Where a field takes part, which moves cells otherwise in every state, nothing is kept."""
        energy, gradient, second = self._elastic.linearise(rows, turn, field)
        if field is not None:
            return energy, gradient, second

        def hessian(along: Array | None = None) -> Array:
            F = self._elasticity.deformation_gradients(rows)
            size = rows.size if along is None else along.shape[1]
            kept = self._kept
            if kept is None or kept[1] != size or self._changed(F, kept[0]) > _SAME:
                self._kept = kept = F, size, second(along)
            return kept[2]

        return energy, gradient, hessian

    def _changed(self, F: Array, before: Array) -> float:
        """Root mean square."""
        return float(np.sqrt(self._share @ ((F - before) ** 2).sum(axis=(1, 2))))
