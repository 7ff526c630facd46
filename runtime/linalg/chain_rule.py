"""Gradients and Hessians of points transformed to the handle rows by the chain rule: J^T f and J^T H J."""

from __future__ import annotations

from softprint.runtime.arrays import Array


def through_basis(basis: Array, gradient: Array, hessian: Array) -> tuple[Array, Array]:
    """sum_i U_i (x) f_i and sum_i U_i U_i^T (x) H_i; basis (m, n_rows)."""
    count, n_rows = basis.shape
    dim = gradient.shape[1]
    right = (hessian[:, :, :, None] * basis[:, None, None, :]).reshape(count, -1)  # (m, i.k.s)
    blocks = (basis.T @ right).reshape(n_rows, dim, dim, n_rows)
    return basis.T @ gradient, blocks.transpose(0, 1, 3, 2).reshape(n_rows * dim, n_rows * dim)


def through_jacobian(jacobian: Array, gradient: Array, hessian: Array) -> tuple[Array, Array]:
    """J^T f and J^T H J; jacobian (m*dim, n_rows*dim)."""
    count, dim = gradient.shape
    right = (hessian @ jacobian.reshape(count, dim, -1)).reshape(jacobian.shape)
    return (jacobian.T @ gradient.ravel()).reshape(-1, dim), jacobian.T @ right
