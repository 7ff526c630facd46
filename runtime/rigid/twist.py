"""Twists of a rigid body, and what an energy of touching points makes of them.

A twist (s, w) moves a body by s and turns it by w about its centre c: R' = exp([w]) R, c' = c + s. It has
dim + dim (dim - 1) / 2 numbers, translation first. With the generators E_k, [w] = sum_k w_k E_k.

An energy of points x_i and the pose P of a body that a common rigid motion does not change sees a twist of the body
as the points moved the other way,

    Phi(x, P') = Phi(c + exp(-[w]) (x - c - s), P).

So with g = dPhi/dx, H = d2Phi/dx2 (point by point), arms a = x - c and B = -(I, E_k a),

    dPhi/dtwist = sum B^T g,        dg/dtwist = H B + (0, E_k g),
    d2Phi/dtwist2 = sum B^T H B + (0, -E_k g; ., g . (E_k E_l + E_l E_k) a / 2),

which is exact.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from runtime.arrays import Array
from runtime.body.rotations import rotation_dofs, skew
from runtime.rigid import kernels


def twist_size(dim: int) -> int:
    """Numbers in a twist: 3 in 2D, 6 in 3D."""
    return dim + rotation_dofs(dim)


@lru_cache
def generators(dim: int) -> Array:
    """E (n_spin, dim, dim)."""
    return np.array([skew(axis) for axis in np.eye(rotation_dofs(dim))])


@lru_cache
def second_generators(dim: int) -> Array:
    """(E_k E_l + E_l E_k) / 2 (n_spin, n_spin, dim, dim)."""
    E = generators(dim)
    products: Array = E[:, None] @ E[None]
    return 0.5 * (products + products.swapaxes(0, 1))


def point_motion(arms: Array) -> Array:
    """(I, E_k a) (m, dim, n_twist): how points of the body at arms (m, dim) from its centre move."""
    return kernels.point_motion(arms)


def turned_along(vectors: Array) -> Array:
    """(0, E_k v) (m, dim, n_twist): how vectors (m, dim) that turn with the body change."""
    changed = point_motion(vectors)
    changed[:, :, : vectors.shape[1]] = 0.0
    return changed


def own_curvature(arms: Array, gradient: Array) -> Array:
    """Of points of the body itself: sum g . (E_k E_l + E_l E_k) a / 2 (n_twist, n_twist), zero for translations."""
    return kernels.own_curvature(arms, gradient)


def relative_curvature(arms: Array, gradient: Array) -> Array:
    """The part of d2Phi/dtwist2 that is not B^T H B (n_twist, n_twist)."""
    dim = arms.shape[1]
    curved = own_curvature(arms, gradient)
    mixed = -(generators(dim) @ gradient.sum(axis=0)).T
    curved[:dim, dim:], curved[dim:, :dim] = mixed, mixed.T
    return curved


def felt_by_the_other(arms: Array, gradient: Array, hessian: Array) -> tuple[Array, Array, Array]:
    """dPhi/dtwist (n_twist,), dg/dtwist (m, dim, n_twist) and d2Phi/dtwist2 (n_twist, n_twist) of the body that the
    points touch; arms, gradient g (m, dim), hessian H (m, dim, dim)."""
    return kernels.of_the_other(arms, gradient, hessian)
