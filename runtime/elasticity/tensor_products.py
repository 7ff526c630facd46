"""Tensor products of deformation gradients, shared by the tangents of several materials."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.invariants import cofactor, determinant


def inverse_transpose(F: Array) -> tuple[Array, Array]:
    """F^-T and log J; NaN where J <= 0."""
    J = determinant(F)
    with np.errstate(invalid="ignore", divide="ignore"):
        return cofactor(F) / np.where(J > 0, J, np.nan)[:, None, None], np.log(np.where(J > 0, J, np.nan))


def crossed(F_inv_T: Array) -> Array:
    """F^-T_il F^-T_kj = -dF^-T_ij / dF_kl, (n, dim, dim, dim, dim)."""
    product: Array = F_inv_T[:, :, None, None, :] * F_inv_T.transpose(0, 2, 1)[:, None, :, :, None]
    return product


def stack(value: Array, count: int) -> Array:
    """A scalar or (n,) as (n, 1, 1)."""
    return np.broadcast_to(value, (count,))[:, None, None]


def outer(M: Array, factor: Array) -> Array:
    """factor M_ij M_kl, (n, dim, dim, dim, dim)."""
    flat = M.reshape(len(M), -1)
    scaled = np.broadcast_to(factor, (len(M),))[:, None] * flat
    return (scaled[:, :, None] * flat[:, None, :]).reshape(M.shape + M.shape[1:])


def add_identity(tangent: Array, factor: Array) -> Array:
    """tangent_ijkl += factor delta_ik delta_jl, in place."""
    diagonal = np.einsum("nijij->nij", tangent)  # a view
    diagonal += np.broadcast_to(factor, (len(tangent),))[:, None, None]
    return tangent
