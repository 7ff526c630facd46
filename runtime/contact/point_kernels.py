"""The sums of `penalty.py` and `friction.py`, compiled: arrays are of some tens of points."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.compiled import compiled


@compiled
def penalty(
    weight: Array, value: Array, slope: Array, bent: Array, rotation: Array
) -> tuple[float, Array, Array, Array, Array]:
    """Energy, gradient (m, dim), Hessian (m, dim, dim), depth (m,) and normal (m, dim) in the world of points with
    weight a k (m,); value (m,), slope (m, dim) and bent (m, dim, dim): the signed distance and its derivatives in the
    collider's coordinates, which rotation R (dim, dim) takes to the world."""
    m, dim = slope.shape
    gradient, normal, depth = np.empty((m, dim)), np.zeros((m, dim)), np.empty(m)
    hessian, half, n = np.empty((m, dim, dim)), np.empty((dim, dim)), np.empty(dim)
    energy = 0.0
    for i in range(m):
        depth[i] = max(-value[i], 0.0)
        stiff, press = 2.0 * weight[i] * depth[i], weight[i] * depth[i] ** 2
        energy += press * depth[i] / 3.0
        square = 0.0
        for a in range(dim):
            n[a] = 0.0
            for b in range(dim):
                n[a] += rotation[a, b] * slope[i, b]
                half[a, b] = 0.0
                for c in range(dim):
                    half[a, b] += rotation[a, c] * bent[i, c, b]
            square += n[a] * n[a]
        length = np.sqrt(square)
        for a in range(dim):
            gradient[i, a] = -press * n[a]
            if length > 0.0:
                normal[i, a] = n[a] / length
            for b in range(dim):
                turned = 0.0
                for c in range(dim):
                    turned += half[a, c] * rotation[b, c]
                hessian[i, a, b] = stiff * n[a] * n[b] - press * turned
    return energy, gradient, hessian, depth, normal


@compiled
def friction(x: Array, anchor: Array, normal: Array, weight: Array, eps: float) -> tuple[float, Array, Array]:
    """Energy, gradient (m, dim) and Hessian (m, dim, dim) at points x (m, dim) of weight mu N (m,)."""
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
            # (f1'(y) - f1(y)/y) / y^2; at y = 0 it multiplies u u^T = 0, so any finite number will do there.
            curvature = -1.0 / (eps**2 * y) if y > 0.0 else 0.0
        energy += weight[i] * f0
        for a in range(dim):
            gradient[i, a] = weight[i] * f1_over_y * u[a]
            for b in range(dim):
                tangent = (1.0 if a == b else 0.0) - normal[i, a] * normal[i, b]
                hessian[i, a, b] = weight[i] * (f1_over_y * tangent + curvature * u[a] * u[b])
    return energy, gradient, hessian
