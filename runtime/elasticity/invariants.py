"""The invariants I_C = F:F and J = det F of deformation gradients F (n, dim, dim), and the derivative of J."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled

Floats = NDArray[np.floating[Any]]


@compiled(reference=lambda F: np.einsum("nij,nij->n", F, F) + 3.0 - F.shape[-1])
def first_invariant(F: Floats) -> Array:
    """I_C (n,) of the deformation in space: F_33 = 1 adds 1 in plane strain."""
    n, dim = F.shape[:2]
    result = np.empty(n)
    for c in range(n):
        total = 3.0 - dim
        for i in range(dim):
            for j in range(dim):
                total += F[c, i, j] * F[c, i, j]
        result[c] = total
    return result


@compiled(reference=np.linalg.det)
def determinant(F: Floats) -> Array:
    """J (n,)."""
    n, dim = F.shape[:2]
    result = np.empty(n)
    for c in range(n):
        if dim == 2:
            result[c] = F[c, 0, 0] * F[c, 1, 1] - F[c, 0, 1] * F[c, 1, 0]
        else:
            result[c] = (
                F[c, 0, 0] * (F[c, 1, 1] * F[c, 2, 2] - F[c, 1, 2] * F[c, 2, 1])
                + F[c, 0, 1] * (F[c, 1, 2] * F[c, 2, 0] - F[c, 1, 0] * F[c, 2, 2])
                + F[c, 0, 2] * (F[c, 1, 0] * F[c, 2, 1] - F[c, 1, 1] * F[c, 2, 0])
            )
    return result


@compiled
def _cofactor(F: Floats, i: int, j: int) -> float:
    """dJ/dF_ij of one F (dim, dim)."""
    if len(F) == 2:
        return F[1 - i, 1 - j] if i == j else -F[1 - i, 1 - j]
    # Row i is the cross product of the other two rows.
    a, b, k, m = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
    return F[a, k] * F[b, m] - F[a, m] * F[b, k]


@compiled(reference=lambda F: np.einsum("n,nji->nij", np.linalg.det(F), np.linalg.inv(F)))
def cofactor(F: Floats) -> Array:
    """dJ/dF_ij (n, dim, dim): the cofactor matrix, finite for singular F too (J F^-T where F is regular)."""
    n, dim = F.shape[:2]
    result = np.empty((n, dim, dim))
    for c in range(n):
        for i in range(dim):
            for j in range(dim):
                result[c, i, j] = _cofactor(F[c], i, j)
    return result
