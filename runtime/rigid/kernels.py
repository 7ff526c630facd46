"""The sums of `twist.py`, compiled, for some tens of points."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled


def _motion(arms: Array) -> Array:
    """B = (I, E_k a) (m, dim, n_twist), with E_k a = e_k x a."""
    m, dim = arms.shape
    E = np.array([[[0.0, -1.0], [1.0, 0.0]]]) if dim == 2 else -np.cross(np.eye(3)[:, None], np.eye(3))
    return np.concatenate(
        [np.broadcast_to(np.eye(dim), (m, dim, dim)), np.einsum("kab,mb->mak", E, arms)], axis=2
    )


def _curvature(arms: Array, g: Array) -> Array:
    """sum g . (E_k E_l + E_l E_k) a / 2, zero for translations; E_k E_l a is a rotation of E_l a."""
    dim = arms.shape[1]
    twice = [_motion(column)[:, :, dim:] for column in np.moveaxis(_motion(arms)[:, :, dim:], 2, 0)]
    bent = np.einsum("ma,lmak->kl", g, np.array(twice))
    return np.pad((bent + bent.T) / 2, (dim, 0))


def _own_body_derivatives(arms: Array, g: Array, H: Array) -> tuple[Array, Array]:
    B = _motion(arms)
    return np.einsum("mat,ma->t", B, g), np.einsum("mas,mab,mbt->st", B, H, B) + _curvature(arms, g)


def _touched_body_derivatives(arms: Array, g: Array, H: Array) -> tuple[Array, Array, Array]:
    """The points stay fixed and the touched body moves; the directions of the forces rotate with it: E_k g."""
    dim, B, along = arms.shape[1], _motion(arms), _motion(g)
    along[:, :, :dim] = 0.0
    slope, own = _own_body_derivatives(arms, g, H)
    mixed = np.pad(along.sum(axis=0), ((0, own.shape[0] - dim), (0, 0)))
    return -slope, along - np.einsum("mab,mbt->mat", H, B), own - mixed - mixed.T


@compiled
def _apply_generator(k: int, v: Array, out: Array) -> None:
    """out = E_k v, the generators of rotations."""
    if len(v) == 2:
        out[0], out[1] = -v[1], v[0]
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        out[k], out[i], out[j] = 0.0, -v[j], v[i]


@compiled(reference=_motion)
def point_motion(arms: Array) -> Array:
    """(I, E_k a) (m, dim, n_twist)."""
    m, dim = arms.shape
    spins = dim * (dim - 1) // 2
    moved, rotated = np.zeros((m, dim, dim + spins)), np.empty(dim)
    for i in range(m):
        for a in range(dim):
            moved[i, a, a] = 1.0
        for k in range(spins):
            _apply_generator(k, arms[i], rotated)
            for a in range(dim):
                moved[i, a, dim + k] = rotated[a]
    return moved


@compiled(reference=_curvature)
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


@compiled(reference=_own_body_derivatives)
def own_body_derivatives(arms: Array, gradient: Array, hessian: Array) -> tuple[Array, Array]:
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


@compiled(reference=_touched_body_derivatives)
def touched_body_derivatives(arms: Array, gradient: Array, hessian: Array) -> tuple[Array, Array, Array]:
    """`touched_body_derivatives` of `twist.py`."""
    m, dim = arms.shape
    B = point_motion(arms)
    size = B.shape[2]
    slope, own = np.zeros(size), own_curvature(arms, gradient)
    pushed, rotated = np.empty((m, dim, size)), np.empty(dim)
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
            _apply_generator(k, gradient[i], rotated)
            for a in range(dim):
                pushed[i, a, dim + k] += rotated[a]
                own[a, dim + k] -= rotated[a]
                own[dim + k, a] -= rotated[a]
    return slope, pushed, own


@compiled(reference=lambda arms, pushed: np.einsum("mas,mat->st", _motion(arms), pushed))
def between(arms: Array, pushed: Array) -> Array:
    """sum (I, E_k a)^T pushed (n_twist, n_twist): the coupling of the twists of the touched body and of the points'
    body."""
    B = point_motion(arms)
    m, dim, size = B.shape
    mixed = np.zeros((size, size))
    for i in range(m):
        for a in range(dim):
            for s in range(size):
                for t in range(size):
                    mixed[s, t] += B[i, a, s] * pushed[i, a, t]
    return mixed


def _ball_meets(R: Array, t: Array, lower: Array, upper: Array, centre: Array, radius: float) -> bool:
    z = (centre - t) @ R
    return bool(np.linalg.norm(z - np.clip(z, lower, upper)) < radius)


@compiled(reference=_ball_meets)
def ball_meets(
    rotation: Array, translation: Array, lower: Array, upper: Array, centre: Array, radius: float
) -> bool:
    """Whether a ball about centre (dim,) reaches the box from lower to upper (dim,) at the pose R, t."""
    dim = len(centre)
    square = 0.0
    for a in range(dim):
        z = 0.0
        for b in range(dim):
            z += rotation[b, a] * (centre[b] - translation[b])
        beyond = max(lower[a] - z, z - upper[a], 0.0)
        square += beyond * beyond
    return square < radius * radius
