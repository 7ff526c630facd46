"""Directions of descent from a factorised Hessian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from softprint.runtime.arrays import Array

# Eigenvalues smaller than this fraction of the largest are raised to it, which bounds the length of a step.
_SMALLEST_EIGENVALUE = 1e-8


@dataclass(frozen=True, eq=False)
class Descent:
    """Descent directions v with H v = -g for gradients g and one factorised Hessian H (n, n): with its Cholesky factor
    (n, n) where H is positive definite, otherwise with |H|, by its eigenvectors (n, n) and the magnitudes of its
    eigenvalues (n,)."""

    cholesky: Array | None
    magnitudes: Array | None = None
    eigenvectors: Array | None = None

    @classmethod
    def of(cls, hessian: Array) -> Descent:
        """Factorises H."""
        try:
            # In C order, the order of a factor that is loaded from a file.
            return cls(np.ascontiguousarray(cho_factor(hessian, lower=True, check_finite=False)[0]))
        except LinAlgError:
            values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
            magnitudes: Array = np.abs(values)
            floor = max(_SMALLEST_EIGENVALUE * float(magnitudes.max()), float(np.finfo(float).tiny))
            return cls(None, np.maximum(magnitudes, floor), np.ascontiguousarray(vectors))

    def __call__(self, gradient: Array) -> Array:
        """v (n,)."""
        if self.cholesky is not None:
            solution: Array = cho_solve((self.cholesky, True), gradient, check_finite=False)
            return -solution
        assert self.magnitudes is not None  # without a Cholesky factor there are eigenvalues
        assert self.eigenvectors is not None
        return -(self.eigenvectors @ ((self.eigenvectors.T @ gradient) / self.magnitudes))
