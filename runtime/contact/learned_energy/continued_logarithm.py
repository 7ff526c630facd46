"""The logarithm in which energies of dents are counted: L(x) = log(1 + x), for x < 0, where 1 + x may vanish, to second
order: x - x^2/2."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array


class ContinuedLogarithm(NamedTuple):
    """L, L' and L'' (n,)."""

    value: Array
    slope: Array
    bend: Array

    @classmethod
    def of(cls, x: Array) -> ContinuedLogarithm:
        """At x (n,)."""
        more, less = np.maximum(x, 0.0), np.minimum(x, 0.0)
        slope = np.where(x > 0.0, 1.0 / (1.0 + more), 1.0 - less)
        return cls(np.log1p(more) + less - 0.5 * less**2, slope, np.where(x > 0.0, -(slope**2), -1.0))
