"""The gradient of a signed distance, smoothed over a ball: finite differences with steps of all sizes (thesis eqs. 6.2
and 6.3).

    g(z) = 1/N sum_j sum_b (phi(z + b) - phi(z - b)) / (2 |b|^2) b,      b in the orthogonal vectors B_j

with N fixed sets of dim orthogonal vectors, their directions uniform and their lengths the quantiles of |N(0, d)|. g is
as smooth as phi, and exact where phi is linear.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import norm

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider, SdfDerivatives

# Points evaluated at a time, to bound memory: each needs the distance at 2 N dim others.
CHUNK = 2048
# The sets are part of the definition of a descriptor, so their seed is fixed.
_SEED = 62


def difference_steps(dim: int, sets: int, radius: float) -> Array:
    """b (sets * dim, dim) [m], the vectors of a set one after the other."""
    rng = np.random.default_rng(_SEED)
    directions, triangular = np.linalg.qr(rng.standard_normal((sets, dim, dim)))
    directions = directions * np.sign(np.diagonal(triangular, axis1=1, axis2=2))[:, None, :]
    count = sets * dim
    quantiles = 0.5 + 0.5 * (np.arange(count) + 0.5) / count
    lengths = radius * rng.permutation(norm.ppf(quantiles))
    return lengths[:, None] * directions.transpose(0, 2, 1).reshape(count, dim)


class SmoothedGradient:
    """g of one collider; sets: N, and d [m] the radius; sets = 0 is the gradient itself, not smoothed."""

    def __init__(self, collider: Collider, radius: float, sets: int) -> None:
        self._collider = collider
        self._steps = difference_steps(collider.dim, sets, radius)
        # b / (2 N |b|^2): the weight of a difference along b.
        square = np.square(self._steps).sum(axis=1, keepdims=True)
        self._share = self._steps / (2.0 * max(sets, 1) * square)

    def value(self, z: Array) -> Array:
        """g (n, dim) at points z (n, dim)."""
        if not len(self._steps):
            return self._collider.sdf_derivatives(z).gradient
        return _in_chunks(self._value, z)

    def derivatives(self, z: Array) -> tuple[Array, Array]:
        """g (n, dim) and dg_a/dz_c (n, dim, dim) [1/m]."""
        if not len(self._steps):
            found = self._collider.sdf_derivatives(z)
            return found.gradient, found.hessian
        return self.value(z), _in_chunks(self._slope, z)

    def _value(self, z: Array) -> Array:
        above, below = (self._collider.sdf(points).reshape(len(z), -1) for points in self._ends(z))
        return (above - below) @ self._share

    def _slope(self, z: Array) -> Array:
        ends = [self._at(points).gradient.reshape(len(z), -1, z.shape[1]) for points in self._ends(z)]
        return np.asarray(self._share.T @ (ends[0] - ends[1]))

    def _at(self, points: Array) -> SdfDerivatives:
        return self._collider.sdf_derivatives(points)

    def _ends(self, z: Array) -> tuple[Array, Array]:
        dim = z.shape[1]
        return (z[:, None] + self._steps).reshape(-1, dim), (z[:, None] - self._steps).reshape(-1, dim)


def _in_chunks(function: Callable[[Array], Array], z: Array) -> Array:
    parts = np.split(z, range(CHUNK, len(z), CHUNK))
    return np.concatenate([function(part) for part in parts])


def unit_normal(gradient: Array) -> Array:
    """n = g / |g| (n, dim); the first axis where g vanishes, where results have no weight (`steadiness.py`)."""
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    somewhere = np.eye(gradient.shape[1])[0]
    return np.where(length > 0.0, gradient / np.where(length > 0.0, length, 1.0), somewhere)


def unit_normal_slope(gradient: Array, slope: Array) -> tuple[Array, Array]:
    """n, and dn/dz (n, dim, dim) [1/m] from dg/dz: (I - n n^T) dg/dz / |g|; zero where g vanishes."""
    n, length = unit_normal(gradient), np.linalg.norm(gradient, axis=1)[:, None, None]
    across = slope - n[:, :, None] * np.einsum("na,nac->nc", n, slope)[:, None, :]
    return n, np.where(length > 0.0, across / np.where(length > 0.0, length, 1.0), 0.0)
