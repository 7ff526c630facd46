"""Compiled kernels of `penalty.py` and `friction.py`, for some tens of points at a time."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled


def _penalty(
    weight: Array, value: Array, slope: Array, curvature: Array, R: Array
) -> tuple[float, Array, Array, Array, Array]:
    """a k/3 depth^3, its gradient - a k depth^2 n and its Hessian a k (2 depth n n^T - depth^2 R curvature R^T), with
    n = R slope."""
    depth, n = np.maximum(-value, 0.0), slope @ R.T
    hessian = np.einsum("m,ma,mb->mab", 2 * weight * depth, n, n)
    hessian -= np.einsum("m,mab->mab", weight * depth**2, R @ curvature @ R.T)
    gradient, unit = -(weight * depth**2)[:, None] * n, n / np.linalg.norm(n, axis=1, keepdims=True)
    return float(weight @ depth**3 / 3), gradient, hessian, depth, unit


@compiled(reference=_penalty)
def penalty(
    weight: Array, value: Array, slope: Array, curvature: Array, rotation: Array
) -> tuple[float, Array, Array, Array, Array]:
    """Energy, gradient (m, dim), Hessian (m, dim, dim), depth (m,) and normal (m, dim), in the world frame, of points
    with weight a k (m,). value (m,), slope (m, dim) and curvature (m, dim, dim): the signed distance and its first and
    second derivatives in the collider's coordinates, which rotation R (dim, dim) takes to the world."""
    m, dim = slope.shape
    gradient, normal, depth = np.empty((m, dim)), np.zeros((m, dim)), np.empty(m)
    hessian, half, n = np.empty((m, dim, dim)), np.empty((dim, dim)), np.empty(dim)
    energy = 0.0
    for i in range(m):
        depth[i] = max(-value[i], 0.0)
        stiffness, pressure = 2.0 * weight[i] * depth[i], weight[i] * depth[i] ** 2
        energy += pressure * depth[i] / 3.0
        square = 0.0
        for a in range(dim):
            n[a] = 0.0
            for b in range(dim):
                n[a] += rotation[a, b] * slope[i, b]
                half[a, b] = 0.0
                for c in range(dim):
                    half[a, b] += rotation[a, c] * curvature[i, c, b]
            square += n[a] * n[a]
        length = np.sqrt(square)
        for a in range(dim):
            gradient[i, a] = -pressure * n[a]
            if length > 0.0:
                normal[i, a] = n[a] / length
            for b in range(dim):
                curved = 0.0
                for c in range(dim):
                    curved += half[a, c] * rotation[b, c]
                hessian[i, a, b] = stiffness * n[a] * n[b] - pressure * curved
    return energy, gradient, hessian, depth, normal


def _friction(
    x: Array, anchor: Array, normal: Array, weight: Array, eps: float
) -> tuple[float, Array, Array]:
    """w f(y) with u = (I - n n^T) (x - anchor) and y = |u|; its gradient w f' u/y and its Hessian
    w (f'/y (I - n n^T) + (f'' - f'/y) u u^T / y^2). f' = 2 y/eps - y^2/eps^2 below eps and 1 above."""
    across = np.eye(x.shape[1]) - np.einsum("ma,mb->mab", normal, normal)
    u = np.einsum("mab,mb->ma", across, x - anchor)
    y, below = np.linalg.norm(u, axis=1), np.linalg.norm(u, axis=1) < eps
    f = np.where(below, y**2 / eps - y**3 / (3 * eps**2) + eps / 3, y)
    first = np.where(below, 2 * y / eps - y**2 / eps**2, 1.0)
    second = np.where(below, 2 / eps - 2 * y / eps**2, 0.0)
    hessian = np.einsum("m,mab->mab", weight * first / y, across)
    hessian += np.einsum("m,ma,mb->mab", weight * (second - first / y) / y**2, u, u)
    return float(weight @ f), (weight * first / y)[:, None] * u, hessian


@compiled(reference=_friction)
def friction(x: Array, anchor: Array, normal: Array, weight: Array, eps: float) -> tuple[float, Array, Array]:
    """Friction energy, gradient (m, dim) and Hessian (m, dim, dim) at points x (m, dim) with weights mu N (m,)."""
    m, dim = x.shape
    gradient, hessian, u = np.empty((m, dim)), np.empty((m, dim, dim)), np.empty(dim)
    energy = 0.0
    for i in range(m):
        off, square = 0.0, 0.0
        for a in range(dim):
            off += (x[i, a] - anchor[i, a]) * normal[i, a]
        for a in range(dim):
            u[a] = x[i, a] - anchor[i, a] - off * normal[i, a]
            square += u[a] * u[a]
        y = np.sqrt(square)
        if y >= eps:
            f0, f1_over_y, curvature = y, 1.0 / y, -1.0 / y**3
        else:
            f0 = y**2 / eps - y**3 / (3.0 * eps**2) + eps / 3.0
            f1_over_y = 2.0 / eps - y / eps**2
            # (f1'(y) - f1(y)/y) / y^2; at y = 0 it multiplies u u^T = 0, so any finite value is correct there.
            curvature = -1.0 / (eps**2 * y) if y > 0.0 else 0.0
        energy += weight[i] * f0
        for a in range(dim):
            gradient[i, a] = weight[i] * f1_over_y * u[a]
            for b in range(dim):
                tangent = (1.0 if a == b else 0.0) - normal[i, a] * normal[i, b]
                hessian[i, a, b] = weight[i] * (f1_over_y * tangent + curvature * u[a] * u[b])
    return energy, gradient, hessian
