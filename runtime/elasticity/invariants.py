"""J = det F and its derivative, for batches of 2x2 and 3x3 matrices."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array


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
