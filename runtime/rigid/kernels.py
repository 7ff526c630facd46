"""The sums of `twist.py`, compiled: arrays are of some tens of points."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.compiled import compiled


@compiled
def _turn(k: int, v: Array, out: Array) -> None:
    """out = E_k v, the generators of rotations."""
    if len(v) == 2:
        out[0], out[1] = -v[1], v[0]
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        out[k], out[i], out[j] = 0.0, -v[j], v[i]


@compiled
def point_motion(arms: Array) -> Array:
    """(I, E_k a) (m, dim, n_twist)."""
    m, dim = arms.shape
    spins = dim * (dim - 1) // 2
    moved, turned = np.zeros((m, dim, dim + spins)), np.empty(dim)
    for i in range(m):
        for a in range(dim):
            moved[i, a, a] = 1.0
        for k in range(spins):
            _turn(k, arms[i], turned)
            for a in range(dim):
                moved[i, a, dim + k] = turned[a]
    return moved


@compiled
def own_curvature(arms: Array, gradient: Array) -> Array:
    """sum g . (E_k E_l + E_l E_k) a / 2 (n_twist, n_twist), with E_k E_l a = e_l (e_k . a) - a (e_k . e_l)."""
    m, dim = arms.shape
    spins = dim * (dim - 1) // 2
    curved = np.zeros((dim + spins, dim + spins))
    for i in range(m):
        along = 0.0
        for a in range(dim):
            along += gradient[i, a] * arms[i, a]
        for k in range(spins):
            curved[dim + k, dim + k] -= along
            if dim == 3:
                for l in range(3):  # noqa: E741
                    mixed = gradient[i, l] * arms[i, k] + gradient[i, k] * arms[i, l]
                    curved[dim + k, dim + l] += 0.5 * mixed
    return curved


@compiled
def of_its_points(arms: Array, gradient: Array, hessian: Array) -> tuple[Array, Array]:
    """sum B^T g (n_twist,) and sum B^T H B + own_curvature (n_twist, n_twist) with B = (I, E_k a)."""
    m, dim = arms.shape
    B = point_motion(arms)
    size = B.shape[2]
    slope, own = np.zeros(size), own_curvature(arms, gradient)
    for i in range(m):
        for t in range(size):
            for a in range(dim):
                slope[t] += B[i, a, t] * gradient[i, a]
            for a in range(dim):
                pushed = 0.0
                for b in range(dim):
                    pushed += hessian[i, a, b] * B[i, b, t]
                for s in range(size):
                    own[s, t] += B[i, a, s] * pushed
    return slope, own


@compiled
def of_the_other(arms: Array, gradient: Array, hessian: Array) -> tuple[Array, Array, Array]:
    """`felt_by_the_other` of `twist.py`."""
    m, dim = arms.shape
    B = point_motion(arms)
    size = B.shape[2]
    slope, own = np.zeros(size), own_curvature(arms, gradient)
    pushed, turned = np.empty((m, dim, size)), np.empty(dim)
    for i in range(m):
        for t in range(size):
            for a in range(dim):
                slope[t] -= B[i, a, t] * gradient[i, a]
                entry = 0.0
                for b in range(dim):
                    entry -= hessian[i, a, b] * B[i, b, t]
                pushed[i, a, t] = entry
                for s in range(size):
                    own[s, t] -= B[i, a, s] * entry
        for k in range(size - dim):
            _turn(k, gradient[i], turned)
            for a in range(dim):
                pushed[i, a, dim + k] += turned[a]
                own[a, dim + k] -= turned[a]
                own[dim + k, a] -= turned[a]
    return slope, pushed, own


@compiled
def between(arms: Array, pushed: Array) -> Array:
    """sum (I, E_k a)^T pushed (n_twist, n_twist): what the twist of the other body does to that of the body itself."""
    B = point_motion(arms)
    m, dim, size = B.shape
    mixed = np.zeros((size, size))
    for i in range(m):
        for a in range(dim):
            for s in range(size):
                for t in range(size):
                    mixed[s, t] += B[i, a, s] * pushed[i, a, t]
    return mixed


@compiled
def ball_meets(
    rotation: Array, translation: Array, lower: Array, upper: Array, centre: Array, radius: float
) -> bool:
    """Whether a ball about centre (dim,) reaches the box from lower to upper (dim,) that is turned and moved."""
    dim = len(centre)
    square = 0.0
    for a in range(dim):
        z = 0.0
        for b in range(dim):
            z += rotation[b, a] * (centre[b] - translation[b])
        beyond = max(lower[a] - z, z - upper[a], 0.0)
        square += beyond * beyond
    return square < radius * radius
