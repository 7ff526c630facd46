"""What a pose makes of derivatives, compiled: of some tens of points."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.compiled import compiled


@compiled
def turned(vectors: Array, matrices: Array, R: Array) -> tuple[Array, Array]:
    """R v and R A R^T of vectors (n, dim) and matrices (n, dim, dim)."""
    n, dim = vectors.shape
    v, A, half = np.zeros((n, dim)), np.zeros((n, dim, dim)), np.empty((dim, dim))
    for i in range(n):
        for a in range(dim):
            for b in range(dim):
                v[i, a] += R[a, b] * vectors[i, b]
                half[a, b] = 0.0
                for c in range(dim):
                    half[a, b] += R[a, c] * matrices[i, c, b]
        for a in range(dim):
            for b in range(dim):
                for c in range(dim):
                    A[i, a, b] += half[a, c] * R[b, c]
    return v, A
