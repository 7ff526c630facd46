"""Neo-Hookean with a logarithmic volume term, continued where the volume is small: finite for every deformation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled
from softprint.runtime.elasticity.invariants import cofactor, determinant
from softprint.runtime.elasticity.material import Material
from softprint.runtime.elasticity.tangent_kernel import isotropic_tangent

#: J_0, the volume ratio below which the logarithm is continued.
CONTINUED = 0.3


class InvertibleNeoHookean(Material):
    """The law of `neo_hookean` (Bonet and Wood 1997, eq. 6.28), whose logarithm is continued below J_0 by its Taylor
    polynomial of second order, as Stomakhin et al. 2012 continue energies by their stretches:

    Psi = mu/2 (F:F - dim) - mu l(J) + lambda/2 l(J)^2,    mu = mu_L, lambda = lambda_L,
    l = log m + d - d^2/2,    m = max(J, J_0),    d = min(J - J_0, 0)/J_0.

    It has two continuous derivatives, and is convex in J up to J = e. A flat cell has a finite energy, but it resists
    with several times the pressure of `stable_neo_hookean`: under edges and tips that law lets cells turn inside out,
    the more of them the finer the mesh is.

    P = mu F + (lambda l - mu) l' dJ/dF,    l' = (1 - d)/m,    l'' = -1/m^2.
    """

    model = "invertible_neo_hookean"
    finite_if_inverted = True

    def energy_density(self, F: Array) -> Array:
        return self.energy_and_stress(F)[0]

    def first_piola(self, F: Array) -> Array:
        return self.energy_and_stress(F)[1]

    def energy_and_stress(self, F: Array) -> tuple[Array, Array]:
        mu, lam = np.broadcast_to(self.mu, len(F)), np.broadcast_to(self.lam, len(F))
        return _energy_and_stress(F, cofactor(F), mu, lam)

    def tangent(self, F: Array) -> Array:
        log_J = _logarithm(determinant(F))
        excess = self.lam * log_J.value - self.mu
        return isotropic_tangent(
            np.ascontiguousarray(F),
            cofactor(F),
            np.broadcast_to(self.mu, len(F)),
            np.zeros(len(F)),
            self.lam * log_J.slope**2 + excess * log_J.bend,
            excess * log_J.slope,
        )


class _Logarithm(NamedTuple):
    """l, l' and l'' (n,)."""

    value: Array
    slope: Array
    bend: Array


def _logarithm(J: Array) -> _Logarithm:
    """Of volume ratios (n,)."""
    m, d = np.maximum(J, CONTINUED), np.minimum(J - CONTINUED, 0.0) / CONTINUED
    return _Logarithm(np.log(m) + d - 0.5 * d**2, (1.0 - d) / m, -1.0 / m**2)


def _energy_and_stress_reference(F: Array, dJ: Array, mu: Array, lam: Array) -> tuple[Array, Array]:
    """Psi and P as in `InvertibleNeoHookean`."""
    log_J, square = _logarithm(np.linalg.det(F)), np.einsum("nij,nij->n", F, F)
    energy = mu * (0.5 * (square - F.shape[1]) - log_J.value) + 0.5 * lam * log_J.value**2
    pressure = (lam * log_J.value - mu) * log_J.slope
    return energy, np.einsum("n,nij->nij", mu, F) + np.einsum("n,nij->nij", pressure, dJ)


@compiled(reference=_energy_and_stress_reference)
def _energy_and_stress(F: Array, dJ: Array, mu: Array, lam: Array) -> tuple[Array, Array]:
    """Psi (n,) and P (n, dim, dim) of `InvertibleNeoHookean`; dJ/dF (n, dim, dim)."""
    n, dim = F.shape[:2]
    energy, stress = np.empty(n), np.empty((n, dim, dim))
    for c in range(n):
        square, J = 0.0, 0.0
        for j in range(dim):
            J += F[c, 0, j] * dJ[c, 0, j]
            for i in range(dim):
                square += F[c, i, j] * F[c, i, j]
        m, d = max(J, CONTINUED), min(J - CONTINUED, 0.0) / CONTINUED
        log_J = np.log(m) + d - 0.5 * d * d
        energy[c] = mu[c] * (0.5 * (square - dim) - log_J) + 0.5 * lam[c] * log_J * log_J
        pressure = (lam[c] * log_J - mu[c]) * (1.0 - d) / m
        for i in range(dim):
            for j in range(dim):
                stress[c, i, j] = mu[c] * F[c, i, j] + pressure * dJ[c, i, j]
    return energy, stress


MATERIAL = InvertibleNeoHookean
