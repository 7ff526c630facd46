"""J = det F and its first two derivatives, for batches of 2x2 and 3x3 matrices."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array


def _levi_civita() -> Array:
    symbol = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        symbol[i, j, k], symbol[i, k, j] = 1.0, -1.0
    return symbol


_EPSILON = _levi_civita()
_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
_SECOND_2D = np.einsum("ik,jl->ijkl", _TURN, _TURN)
# d2J/dF_ij dF_kl = epsilon_ikm epsilon_jln F_mn, as a (9, 81) matrix that acts on F flattened row by row.
_SECOND_3D = np.einsum("ikm,jln->mnijkl", _EPSILON, _EPSILON).reshape(9, 81)


def determinant(F: Array) -> Array:
    """J (n,) of F (n, dim, dim)."""
    if F.shape[-1] == 2:
        return F[:, 0, 0] * F[:, 1, 1] - F[:, 0, 1] * F[:, 1, 0]
    return (
        F[:, 0, 0] * (F[:, 1, 1] * F[:, 2, 2] - F[:, 1, 2] * F[:, 2, 1])
        + F[:, 0, 1] * (F[:, 1, 2] * F[:, 2, 0] - F[:, 1, 0] * F[:, 2, 2])
        + F[:, 0, 2] * (F[:, 1, 0] * F[:, 2, 1] - F[:, 1, 1] * F[:, 2, 0])
    )


def cofactor(F: Array) -> Array:
    """dJ/dF_ij, (n, dim, dim): the cofactor matrix, finite for singular F too (J F^-T where F is regular)."""
    result = np.empty_like(F)
    if F.shape[-1] == 2:
        result[:, 0, 0], result[:, 0, 1] = F[:, 1, 1], -F[:, 1, 0]
        result[:, 1, 0], result[:, 1, 1] = -F[:, 0, 1], F[:, 0, 0]
        return result
    for i in range(3):
        a, b = (
            F[:, (i + 1) % 3],
            F[:, (i + 2) % 3],
        )  # row i of the cofactor is the cross product of the other two rows
        for j in range(3):
            k, m = (j + 1) % 3, (j + 2) % 3
            result[:, i, j] = a[:, k] * b[:, m] - a[:, m] * b[:, k]
    return result


def second_derivative(F: Array) -> Array:
    """d2J/dF_ij dF_kl, (n, dim, dim, dim, dim)."""
    if F.shape[-1] == 2:
        return np.broadcast_to(_SECOND_2D, (len(F), 2, 2, 2, 2))
    return (F.reshape(-1, 9) @ _SECOND_3D).reshape(-1, 3, 3, 3, 3)
