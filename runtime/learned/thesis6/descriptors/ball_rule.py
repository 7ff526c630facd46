"""Cubature of degree 7 on the unit ball, whose points are the sampling pattern of descriptors (thesis 6.2.3).

A product rule: Gauss's two radii for the weight r^(dim-1), equal weights at eight angles, and in 3D Gauss-Legendre's
four heights on the sphere; 64 points (Stroud 1971, S3: 7-4), in the plane 16. An even polynomial in r of degree 6 with
that weight needs two radii, one in cos(theta) four heights, one in the azimuth eight angles.

The polar axis is the first one, which a contact frame rotates to the normal: a rotation by 45 degrees about the normal
maps the pattern onto itself, and no point lies in the plane across it.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array

_ANGLES = 2 * np.pi * (np.arange(8) + 0.5) / 8


def ball_rule(dim: int) -> tuple[Array, Array]:
    """Points (m, dim) within the unit ball (disc in 2D) and weights (m,), which sum to its volume."""
    radii, radial = _radii(dim)
    if dim == 2:
        directions = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
        angular = np.full(8, 2 * np.pi / 8)
    else:
        height, height_weight = np.polynomial.legendre.leggauss(4)
        across = np.sqrt(1.0 - height**2)
        x = np.repeat(height, 8)
        y, z = (np.outer(across, circle).ravel() for circle in (np.cos(_ANGLES), np.sin(_ANGLES)))
        directions = np.column_stack([x, y, z])
        angular = np.repeat(height_weight, 8) * 2 * np.pi / 8
    points = (radii[:, None, None] * directions).reshape(-1, dim)
    return points, np.outer(radial, angular).ravel()


def sample_pattern(dim: int) -> Array:
    """w_i (m + 1, dim): the centre, and the points of the rule."""
    return np.vstack([np.zeros(dim), ball_rule(dim)[0]])


def _radii(dim: int) -> tuple[Array, Array]:
    """Two radii and weights, exact for int_0^1 p(r^2) r^(dim-1) dr with p of degree 3.

    With s = r^2 and moments m_k = 1 / (2k + dim): the roots of the quadratic that is orthogonal to 1 and s.
    """
    m = 1.0 / (2.0 * np.arange(4) + dim)
    low = np.linalg.solve(np.array([[m[0], m[1]], [m[1], m[2]]]), -m[2:])
    s = np.sort(np.roots([1.0, low[1], low[0]]).real)
    weight = np.linalg.solve(np.vstack([np.ones(2), s]), m[:2])
    return np.sqrt(s), weight
