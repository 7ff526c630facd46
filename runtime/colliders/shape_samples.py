"""Signed distances at some points, by which a collider is told from another of the same name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider

_POINTS = 64
# Distances may differ by this share of the size: grids of another resolution are no other shape.
_SAME = 2e-3


def shape_samples(collider: Collider) -> Array:
    """(2 dim + 64,) [m]: the bounds, and signed distances at points drawn between them. Without bounds, in a cube of
    two metres."""
    lower = np.where(np.isfinite(collider.lower), collider.lower, -1.0)
    upper = np.where(np.isfinite(collider.upper), collider.upper, 1.0)
    drawn = np.random.default_rng(0).uniform(size=(_POINTS, collider.dim))
    return np.concatenate([lower, upper, collider.sdf(lower + drawn * (upper - lower))])


def is_same_shape(collider: Collider, samples: Sequence[float] | Array) -> bool:
    """Whether the collider has these `shape_samples`, about."""
    own, other = shape_samples(collider), np.asarray(samples, dtype=float)
    if own.shape != other.shape:
        return False
    size = float(np.ptp(own[: 2 * collider.dim]))
    return bool(np.abs(own - other).max() <= _SAME * size)
