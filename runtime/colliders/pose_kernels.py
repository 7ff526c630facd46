"""Rotation of signed-distance derivatives by a pose, compiled; for some tens of points."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled


@compiled(reference=lambda vectors, matrices, R: (vectors @ R.T, R @ matrices @ R.T))
def rotated(vectors: Array, matrices: Array, R: Array) -> tuple[Array, Array]:
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
