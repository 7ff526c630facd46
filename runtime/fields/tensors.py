"""Strain and stress of deformation gradients F (n, 3, 3).

    E = (F^T F - I) / 2               Green strain [1]
    sigma = J^-1 P F^T, J = det F     Cauchy stress [Pa], P = dPsi/dF
    sqrt(3/2 s:s), s = dev sigma      von Mises stress [Pa]

A 2D body is in plane strain: its F is completed by F_33 = 1, so E_33 = 0, and the out-of-plane stress, which is not
zero, is included.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.invariants import determinant
from softprint.runtime.elasticity.materials import Material


def in_three_dimensions(F: Array) -> Array:
    """(n, 3, 3) from (n, dim, dim): F_33 = 1 in plane strain."""
    dim = F.shape[-1]
    full = np.broadcast_to(np.eye(3), (len(F), 3, 3)).copy()
    full[:, :dim, :dim] = F
    return full


def green_strain(F: Array) -> Array:
    """E (n, 3, 3)."""
    return 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3))


def cauchy_stress(material: Material, F: Array) -> Array:
    """sigma (n, 3, 3) [Pa], symmetric; not finite where det F is 0, or where the material's stress is undefined."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return material.first_piola(F) @ F.transpose(0, 2, 1) / determinant(F)[:, None, None]


def von_mises(stress: Array) -> Array:
    """(n,) [Pa] of Cauchy stresses (n, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return np.sqrt(1.5 * (deviator * deviator).sum(axis=(1, 2)))
