"""A manufactured solution of finite elasticity: a displacement, and the body force under which it is in equilibrium.

    u(X) = A sin(B X + c)  (the sine of each component),   F = I + A diag(cos(B X + c)) B,   f = -Div P(F).

The stress is that of the textbook, so that a wrong energy in Softprint would change every order of convergence:
P = mu (F - F^-T) + lambda log J F^-T. Its divergence is computed by complex steps, exact to round-off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl

from softprint.runtime.arrays import Array

_COMPLEX_STEP = 1e-30  # complex steps have no cancellation, so it may be this small


@dataclass(frozen=True)
class Manufactured:
    """amplitude: A (dim, dim) [m]; wave: B (dim, dim) [1/m]; phase: c (dim,); mu, lam [Pa]."""

    amplitude: Array
    wave: Array
    phase: Array
    mu: float
    lam: float

    @property
    def dim(self) -> int:
        return len(self.phase)

    def displacement(self, X: Array) -> Array:
        """u (n, dim) at X (n, dim)."""
        return np.sin(X @ self.wave.T + self.phase) @ self.amplitude.T

    def gradient(self, X: Array) -> Array:
        """du_i/dX_j, (n, dim, dim); X may be complex."""
        slope = np.cos(X @ self.wave.T + self.phase)
        return np.einsum("ia,na,aj->nij", self.amplitude, slope, self.wave)

    def first_piola(self, X: Array) -> Array:
        """P (n, dim, dim) [Pa]; X may be complex."""
        F = np.eye(self.dim) + self.gradient(X)
        J = np.linalg.det(F)
        inverse_transpose = np.linalg.inv(F).transpose(0, 2, 1)
        return self.mu * (F - inverse_transpose) + self.lam * np.log(J)[:, None, None] * inverse_transpose

    def body_force(self, X: Array) -> Array:
        """f_i = -dP_ij/dX_j (n, dim) [N/m^dim]."""
        force = np.zeros_like(X)
        for j in range(self.dim):
            step = np.zeros(self.dim, dtype=complex)
            step[j] = _COMPLEX_STEP * 1j
            force -= self.first_piola(X + step)[:, :, j].imag / _COMPLEX_STEP
        return force

    def displacement_form(self, X: Any) -> Any:
        """u as a UFL expression of the position."""
        dim = self.dim
        angles = [
            sum(float(self.wave[a, j]) * X[j] for j in range(dim)) + float(self.phase[a]) for a in range(dim)
        ]
        return ufl.as_vector(
            [sum(float(self.amplitude[i, a]) * ufl.sin(angles[a]) for a in range(dim)) for i in range(dim)]
        )


def wavy(dim: int, mu: float, lam: float) -> Manufactured:
    """A solution on the unit square or cube: strains up to about 0.5, anisotropic in both X and u."""
    amplitude = np.array([[0.10, 0.04, -0.02], [-0.03, 0.09, 0.03], [0.02, -0.03, 0.08]])[:dim, :dim]
    wave = np.array([[2.0, 1.0, 0.5], [-0.5, 2.2, 1.0], [1.0, -0.6, 1.8]])[:dim, :dim]
    return Manufactured(amplitude, wave, np.array([0.3, 1.1, -0.4])[:dim], mu, lam)
