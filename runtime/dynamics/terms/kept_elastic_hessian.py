"""The elastic Hessian of an earlier state, used again while the strain of the body has changed little.

With many handles the Hessian of all cubature cells costs more than the rest of a step in the subspace. It changes
little from one iteration or step to the next, since the tangent of a material changes with the deformation gradient.
The Hessian only gives Newton's method a direction; energy and gradient are exact, and so is the solution. The Hessian
is kept along the requested directions, the free coordinates of points and frames: they rotate with the body, so that it
changes only with the strain. Where other coordinates are free, it is computed anew. In the motion of the hand of
`examples/hand.toml`, without corrections, this takes 3.1 iterations per step instead of 3.0, and three fifths of the
time (medians); with a correction, whose Hessian has near frames only, 2.1 instead of 2.0 and nine tenths.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray, RowHessian
from softprint.runtime.dynamics.terms.elastic import Elastic
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity

# The largest change of the deformation gradient (RMS over the cells) for which a Hessian is used again.
_SAME_STRAIN = 0.03
# Hessians of fewer multiplications are cheaper than the additional iterations that an old Hessian may cause.
_EXPENSIVE = 1e7


class KeptHessian(NamedTuple):
    """hessian (k, k) [N/m] by the free coordinates free (k,), computed where the cells had deformation gradients F (m,
    dim, dim)."""

    F: Array
    free: IntArray
    hessian: Array


class HessianReuse:
    """Decides whether a kept Hessian is used again. elasticity: of the body, to measure its strain."""

    def __init__(self, elasticity: ReducedElasticity) -> None:
        self._elasticity = elasticity
        self._share = elasticity.weights / elasticity.weights.sum()

    @classmethod
    def if_expensive(cls, elastic: Elastic, elasticity: ReducedElasticity) -> HessianReuse | None:
        """For a body whose elastic Hessian is expensive; None for others."""
        return cls(elasticity) if elastic.products > _EXPENSIVE else None

    def hessian(
        self, rows: Array, free: IntArray, along: Array | None, compute: RowHessian, kept: KeptHessian | None
    ) -> KeptHessian:
        """The kept Hessian if it can be used again at handle rows (n_rows, dim), otherwise that of `compute`; free:
        (k,) the coordinates that the k directions `along` change, see `RowHessian`."""
        F = self._elasticity.deformation_gradients(rows)
        if kept is not None and np.array_equal(kept.free, free) and self._change(F, kept.F) <= _SAME_STRAIN:
            return kept
        return KeptHessian(F, free, compute(along))

    def _change(self, F: Array, before: Array) -> float:
        """The change of the deformation gradients (weighted RMS over the cells)."""
        return float(np.sqrt(self._share @ ((F - before) ** 2).sum(axis=(1, 2))))
