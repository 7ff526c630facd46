"""Twists of a rigid body, and the derivatives of a contact energy with respect to them.

A twist (s, w) translates a body by s and rotates it by w about its centre c: R' = exp([w]) R, c' = c + s. It has
dim + dim (dim - 1) / 2 numbers, translation first. With the generators E_k, [w] = sum_k w_k E_k.

Let an energy of points x_i and the pose P of a body be invariant under common rigid motions of both. A twist of the
body is then equivalent to the opposite motion of the points,

    Phi(x, P') = Phi(c + exp(-[w]) (x - c - s), P).

So with g = dPhi/dx, H = d2Phi/dx2 (point by point), arms a = x - c and B = -(I, E_k a),

    dPhi/dtwist = sum B^T g,        dg/dtwist = H B + (0, E_k g),
    d2Phi/dtwist2 = sum B^T H B + (0, -E_k g; ., g . (E_k E_l + E_l E_k) a / 2),

which is exact.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.rotations import rotation_dofs, skew
from softprint.runtime.rigid import kernels


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
    """(I, E_k a) (m, dim, n_twist): the derivative, by the twist, of body points at arms (m, dim) from the centre."""
    return kernels.point_motion(arms)


def rotation_derivatives(vectors: Array) -> Array:
    """(0, E_k v) (m, dim, n_twist): the derivative, by the twist, of vectors (m, dim) that rotate with the body."""
    changed = point_motion(vectors)
    changed[:, :, : vectors.shape[1]] = 0.0
    return changed


def own_curvature(arms: Array, gradient: Array) -> Array:
    """For points fixed to the body: sum g . (E_k E_l + E_l E_k) a / 2 (n_twist, n_twist), zero for translations."""
    return kernels.own_curvature(arms, gradient)


def relative_curvature(arms: Array, gradient: Array) -> Array:
    """d2Phi/dtwist2 without B^T H B (n_twist, n_twist)."""
    dim = arms.shape[1]
    curved = own_curvature(arms, gradient)
    mixed = -(generators(dim) @ gradient.sum(axis=0)).T
    curved[:dim, dim:], curved[dim:, :dim] = mixed, mixed.T
    return curved


def touched_body_derivatives(arms: Array, gradient: Array, hessian: Array) -> tuple[Array, Array, Array]:
    """dPhi/dtwist (n_twist,), dg/dtwist (m, dim, n_twist) and d2Phi/dtwist2 (n_twist, n_twist) of the body that the
    points touch; arms, gradient g (m, dim), hessian H (m, dim, dim)."""
    return kernels.touched_body_derivatives(arms, gradient, hessian)
