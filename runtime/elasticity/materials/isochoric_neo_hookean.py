"""Neo-Hookean with separate energies of shape and volume, for nearly incompressible solids."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.invariants import determinant, first_invariant
from softprint.runtime.elasticity.material import Material
from softprint.runtime.elasticity.tensor_products import add_identity, crossed, inverse_transpose, outer


class IsochoricNeoHookean(Material):
    """Neo-Hookean in the volume-preserving part of the deformation (Simo and Miehe 1992; Holzapfel 2000, sec. 6.4):

    Psi = mu/2 (J^(-2/3) I_C - 3) + kappa/4 (J^2 - 1 - 2 log J),    mu = mu_L, kappa = lambda_L + 2/3 mu_L.

    P = mu J^(-2/3) (F - I_C/3 F^-T) + kappa/2 (J^2 - 1) F^-T. Shape and volume are separated: the pressure depends on J
    alone, which suits nearly incompressible solids. The energy is infinite for J <= 0, where stress and tangent are not
    defined (NaN).
    """

    model = "isochoric_neo_hookean"

    @cached_property
    def bulk(self) -> Array:
        """kappa [Pa], the bulk modulus."""
        return np.asarray(self.lame_lambda + 2.0 / 3.0 * self.lame_mu)

    def energy_density(self, F: Array) -> Array:
        J = determinant(F)
        with np.errstate(invalid="ignore", divide="ignore"):
            shape = 0.5 * self.mu * (np.cbrt(J) ** -2 * first_invariant(F) - 3.0)
            density = shape + 0.25 * self.bulk * (J**2 - 1.0 - 2.0 * np.log(J))
        return np.where(J > 0, density, np.inf)

    def first_piola(self, F: Array) -> Array:
        F_inv_T, log_J = inverse_transpose(F)
        shear = self.mu * np.exp(-2.0 / 3.0 * log_J)
        pressure = 0.5 * self.bulk * np.expm1(2.0 * log_J)
        spherical = pressure - shear * first_invariant(F) / 3.0
        return shear[:, None, None] * F + spherical[:, None, None] * F_inv_T

    def tangent(self, F: Array) -> Array:
        F_inv_T, log_J = inverse_transpose(F)
        shear, trace = self.mu * np.exp(-2.0 / 3.0 * log_J), first_invariant(F)
        pressure = 0.5 * self.bulk * np.expm1(2.0 * log_J)
        result = (shear * trace / 3.0 - pressure)[:, None, None, None, None] * crossed(F_inv_T)
        volume = self.bulk * np.exp(2.0 * log_J) + 2.0 / 9.0 * shear * trace
        result += outer(F_inv_T, volume)
        # F (x) F^-T + F^-T (x) F, each symmetric in the exchange of both
        mixed: Array = F[:, :, :, None, None] * F_inv_T[:, None, None, :, :]
        mixed = mixed + mixed.transpose(0, 3, 4, 1, 2)
        result -= (2.0 / 3.0 * shear)[:, None, None, None, None] * mixed
        return add_identity(result, shear)


MATERIAL = IsochoricNeoHookean
