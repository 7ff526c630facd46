"""Attenuation: a factor that reduces contact deformation to zero at the distance d from the collider, the range of the
descriptor (thesis 6.2.4):

    a(phi) = 1 - S((phi / d - h) / (1 - h)),    S(s) = s^2 (3 - 2 s) on [0, 1],

one up to the distance h d, zero from d on, C1. No model can learn what it removes: with h = 0 that is 10 % of the
squared displacement of a jelly under the library's shapes, with h = 1/2 it is 4 %.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array

HOLD = 0.5  # h


def attenuation(distance: Array, radius: float) -> Array:
    """a (n,) at signed distances (n,) [m]."""
    s = _share(distance, radius)
    return 1.0 - s * s * (3.0 - 2.0 * s)


def attenuation_slope(distance: Array, radius: float) -> Array:
    """da/dphi (n,) [1/m]."""
    s = _share(distance, radius)
    return -6.0 * s * (1.0 - s) / ((1.0 - HOLD) * radius)


def _share(distance: Array, radius: float) -> Array:
    return np.clip((distance / radius - HOLD) / (1.0 - HOLD), 0.0, 1.0)
