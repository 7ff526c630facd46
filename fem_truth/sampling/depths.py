"""Depths of one contact: even steps to the largest depth, with a little noise (thesis 5.3.2)."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array


def noisy_depths(count: int, max_depth: float, noise: float, rng: np.random.Generator) -> Array:
    """(count,) ascending depths [m]: d_j = (j - noise u_j) max_depth / count, j = 1..count, u_j uniform in
    [0, 1).

    noise in [0, 1) is a share of the step between depths. No depth is above max_depth, and none is 0.
    """
    return (np.arange(1, count + 1) - noise * rng.random(count)) * max_depth / count
