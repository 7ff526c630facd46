"""Stable Neo-Hookean: finite for every deformation gradient, inverted ones too."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled
from softprint.runtime.elasticity.invariants import cofactor, determinant, first_invariant
from softprint.runtime.elasticity.material import Material
from softprint.runtime.elasticity.tangent_kernel import isotropic_tangent


class StableNeoHookean(Material):
    """Stable Neo-Hookean of Smith, de Goes and Kim 2018 (eq. 14, with the origin barrier), zero and
    stress-free at rest:

    Psi = mu/2 (I_C - 3) - mu/2 log((I_C + 1)/4) - 3/4 mu (J - 1) + lambda/2 (J - 1)^2,    I_C = F:F (+ 1 in
    2D),

    which is their lambda/2 (J - alpha)^2 with alpha = 1 + mu/lambda - mu/(4 lambda), less its value at
    rest. Finite for every F, inverted or flat. Their remapping makes E and nu exact at small strain: mu =
    4/3 mu_L, lambda = lambda_L + 5/6 mu_L.

    P = mu (1 - 1/(I_C + 1)) F + (lambda (J - 1) - 3/4 mu) dJ/dF.
    """

    model = "stable_neo_hookean"
    finite_if_inverted = True

    @cached_property
    def mu(self) -> Array:
        return np.asarray(4.0 / 3.0 * self.lame_mu)

    @cached_property
    def lam(self) -> Array:
        return np.asarray(self.lame_lambda + 5.0 / 6.0 * self.lame_mu)

    def energy_density(self, F: Array) -> Array:
        return self.energy_and_stress(F)[0]

    def first_piola(self, F: Array) -> Array:
        return self.energy_and_stress(F)[1]

    def energy_and_stress(self, F: Array) -> tuple[Array, Array]:
        mu, lam = np.broadcast_to(self.mu, len(F)), np.broadcast_to(self.lam, len(F))
        return _energy_and_stress(F, cofactor(F), mu, lam)

    def tangent(self, F: Array) -> Array:
        barrier = 1.0 / (first_invariant(F) + 1.0)
        stretch = self.mu * (1.0 - barrier)
        pressure = self.lam * (determinant(F) - 1.0) - 0.75 * self.mu
        return isotropic_tangent(
            np.ascontiguousarray(F),
            cofactor(F),
            stretch,
            2.0 * self.mu * barrier**2,
            np.broadcast_to(self.lam, stretch.shape),
            pressure,
        )


def _energy_and_stress_reference(F: Array, dJ: Array, mu: Array, lam: Array) -> tuple[Array, Array]:
    """Psi and P as in `StableNeoHookean`."""
    I_C, J = 3 - F.shape[1] + np.einsum("nij,nij->n", F, F), np.linalg.det(F)
    energy = mu / 2 * (I_C - 3 - np.log((I_C + 1) / 4)) - 0.75 * mu * (J - 1) + lam / 2 * (J - 1) ** 2
    stress = np.einsum("n,nij->nij", mu * (1 - 1 / (I_C + 1)), F)
    return energy, stress + np.einsum("n,nij->nij", lam * (J - 1) - 0.75 * mu, dJ)


@compiled(reference=_energy_and_stress_reference)
def _energy_and_stress(F: Array, dJ: Array, mu: Array, lam: Array) -> tuple[Array, Array]:
    """Psi (n,) and P (n, dim, dim) of `StableNeoHookean`; dJ/dF (n, dim, dim)."""
    n, dim = F.shape[:2]
    energy, stress = np.empty(n), np.empty((n, dim, dim))
    for c in range(n):
        trace, volume = 3.0 - dim, -1.0
        for j in range(dim):
            volume += F[c, 0, j] * dJ[c, 0, j]
            for i in range(dim):
                trace += F[c, i, j] * F[c, i, j]
        shear = 0.5 * (trace - 3.0) - 0.5 * np.log((trace + 1.0) / 4.0) - 0.75 * volume
        energy[c] = mu[c] * shear + 0.5 * lam[c] * volume**2
        stretch, pressure = mu[c] * (1.0 - 1.0 / (trace + 1.0)), lam[c] * volume - 0.75 * mu[c]
        for i in range(dim):
            for j in range(dim):
                stress[c, i, j] = stretch * F[c, i, j] + pressure * dJ[c, i, j]
    return energy, stress


MATERIAL = StableNeoHookean
