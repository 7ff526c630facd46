"""The functions f in which ratios of energies of dents are counted, with their first two derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array


class RatioFunction(NamedTuple):
    """f, f' and f'' (n,)."""

    value: Array
    slope: Array
    bend: Array


def continued_logarithm(x: Array) -> RatioFunction:
    """L(x) = log(1 + x), for x < 0, where 1 + x may vanish, to second order: x - x^2/2."""
    more, less = np.maximum(x, 0.0), np.minimum(x, 0.0)
    slope = np.where(x > 0.0, 1.0 / (1.0 + more), 1.0 - less)
    return RatioFunction(np.log1p(more) + less - 0.5 * less**2, slope, np.where(x > 0.0, -(slope**2), -1.0))


def bounded(x: Array) -> RatioFunction:
    """tanh(x), which is x where that is small, and never larger than one."""
    value = np.tanh(x)
    slope = 1.0 - value**2
    return RatioFunction(value, slope, -2.0 * value * slope)
