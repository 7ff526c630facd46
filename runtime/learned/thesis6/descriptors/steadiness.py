"""Steadiness: a factor that reduces contact deformation to zero where the smoothed gradient g vanishes, so that the
normal is undefined:

    b(g) = S(|g| / FAINT),    S(s) = 6 s^5 - 15 s^4 + 10 s^3 on [0, 1], one beyond.

There is such a point inside every collider, and there may be some in notches and between arms, where attenuation with
distance does not remove them. Around it the unit normal takes all directions, and results in its frame are
discontinuous; b g / |g| is C2. Contacts hardly reach such points: of 240,000 nodes near the library's shapes, at the
depths of the truth data, 2 had |g| < FAINT, with 0.003 % of the squared displacement that a trained model predicts.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array

FAINT = 0.1


def steadiness(gradient: Array) -> Array:
    """b (n,) of smoothed gradients g (n, dim)."""
    s = _share(gradient)
    return s**3 * (6 * s**2 - 15 * s + 10)


def steadiness_slope(gradient: Array, slope: Array) -> Array:
    """db/dz (n, dim) [1/m], from dg/dz (n, dim, dim): S'(s) / s  g . dg/dz / FAINT^2."""
    s = _share(gradient)
    steep = 30 * s * (1 - s) ** 2 / FAINT**2
    return np.asarray(steep[:, None] * np.einsum("na,nac->nc", gradient, slope))


def _share(gradient: Array) -> Array:
    return np.minimum(np.linalg.norm(gradient, axis=1) / FAINT, 1.0)
