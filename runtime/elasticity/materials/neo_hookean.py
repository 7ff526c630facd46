"""Neo-Hookean with a logarithmic volume term."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.invariants import determinant, first_invariant
from softprint.runtime.elasticity.material import Material
from softprint.runtime.elasticity.tensor_products import (
    add_identity,
    crossed,
    inverse_transpose,
    outer,
    stack,
)


class NeoHookean(Material):
    """Neo-Hookean with logarithmic volume term (Bonet and Wood 1997, eq. 6.28):

    Psi = mu/2 (F:F - dim) - mu log J + lambda/2 (log J)^2,    mu = mu_L, lambda = lambda_L.

    P = mu F + (lambda log J - mu) F^-T. The energy is infinite for J <= 0 (a line search never accepts such a step),
    where stress and tangent are not defined (NaN).
    """

    model = "neo_hookean"

    def energy_density(self, F: Array) -> Array:
        J = determinant(F)
        with np.errstate(invalid="ignore", divide="ignore"):
            log_J = np.log(J)
            density = self.mu * (0.5 * (first_invariant(F) - 3.0) - log_J) + 0.5 * self.lam * log_J**2
        return np.where(J > 0, density, np.inf)

    def first_piola(self, F: Array) -> Array:
        F_inv_T, log_J = inverse_transpose(F)
        return stack(self.mu, len(F)) * F + (self.lam * log_J - self.mu)[:, None, None] * F_inv_T

    def tangent(self, F: Array) -> Array:
        F_inv_T, log_J = inverse_transpose(F)
        result = (self.mu - self.lam * log_J)[:, None, None, None, None] * crossed(F_inv_T)
        result += outer(F_inv_T, self.lam)
        return add_identity(result, self.mu)


MATERIAL = NeoHookean
