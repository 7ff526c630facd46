"""Rotations of the collider: farthest points of SO(dim) in the angle of the relative rotation (thesis
5.3.2)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from softprint.fem_truth.sampling.farthest import farthest_selection
from softprint.runtime.arrays import Array

# Candidates per requested rotation: with 100, the greedy choice is within a few per cent of that from a much larger
# pool.
_POOL_FACTOR = 100
_POOL_LEAST = 2000


def spread_rotations(dim: int, count: int, rng: np.random.Generator) -> Array:
    """(count, dim, dim) rotations in farthest-point order.

    2D: evenly spaced angles with a random offset. 3D: the first is the identity (the collider as modelled), the others
    come from a large pool of uniformly random rotations.
    """
    if dim == 2:
        return _spread_in_the_plane(count, rng)
    pool_size = max(_POOL_LEAST, _POOL_FACTOR * count)
    quaternions = rng.standard_normal((pool_size, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    quaternions[0] = (0.0, 0.0, 0.0, 1.0)  # scipy's order: the real part last
    chosen = farthest_selection(lambda k: _angle(quaternions, quaternions[k]), 0, count)
    return np.asarray(Rotation.from_quat(quaternions[chosen]).as_matrix(), dtype=float)


def random_rotation(dim: int, rng: np.random.Generator) -> Array:
    """(dim, dim), drawn uniformly from SO(dim)."""
    if dim == 2:
        c, s = np.cos(angle := 2 * np.pi * rng.random()), np.sin(angle)
        return np.array([[c, -s], [s, c]])
    return np.asarray(Rotation.from_quat(rng.standard_normal(4)).as_matrix(), dtype=float)


def _spread_in_the_plane(count: int, rng: np.random.Generator) -> Array:
    angles = 2 * np.pi * (np.arange(count) + rng.random()) / count
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    order = farthest_selection(lambda k: np.arccos(np.clip(directions @ directions[k], -1.0, 1.0)), 0, count)
    c, s = directions[order].T
    return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)


def _angle(quaternions: Array, other: Array) -> Array:
    """(n,) angles [rad] of the rotations from ``other`` (4,) to quaternions (n, 4); q and -q are the same
    rotation."""
    return 2.0 * np.arccos(np.clip(np.abs(quaternions @ other), 0.0, 1.0))
