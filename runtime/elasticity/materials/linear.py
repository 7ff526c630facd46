"""Linear elasticity, for small displacements."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled
from softprint.runtime.elasticity.material import Material


class Linear(Material):
    """Small-strain linear elasticity: Psi = mu eps:eps + lambda/2 (tr eps)^2 with eps = (F + F^T)/2 - I.

    Not invariant under rotations: for small displacements only.
    """

    model = "linear"
    rotation_invariant = False
    finite_if_inverted = True

    def energy_density(self, F: Array) -> Array:
        return self.energy_and_stress(F)[0]

    def first_piola(self, F: Array) -> Array:
        return self.energy_and_stress(F)[1]

    def energy_and_stress(self, F: Array) -> tuple[Array, Array]:
        mu, lam = np.broadcast_to(self.mu, len(F)), np.broadcast_to(self.lam, len(F))
        return _energy_and_stress(np.ascontiguousarray(F), mu, lam)

    def tangent(self, F: Array) -> Array:
        n, dim = len(F), F.shape[-1]
        return _tangent(dim, np.broadcast_to(self.mu, n), np.broadcast_to(self.lam, n))


def _in_strains(F: Array, mu: Array, lam: Array) -> tuple[Array, Array]:
    """Psi and P as in `Linear`."""
    identity = np.eye(F.shape[-1])
    strain = 0.5 * (F + F.transpose(0, 2, 1)) - identity
    trace = np.trace(strain, axis1=1, axis2=2)
    energy = mu * (strain * strain).sum(axis=(1, 2)) + 0.5 * lam * trace**2
    return energy, 2.0 * mu[:, None, None] * strain + (lam * trace)[:, None, None] * identity


@compiled(reference=_in_strains)
def _energy_and_stress(F: Array, mu: Array, lam: Array) -> tuple[Array, Array]:
    """Psi (n,) and P (n, dim, dim)."""
    n, dim, _ = F.shape
    energy, stress = np.empty(n), np.empty((n, dim, dim))
    for c in range(n):
        trace = square = 0.0
        for i in range(dim):
            trace += F[c, i, i] - 1.0
        for i in range(dim):
            for j in range(dim):
                strain = 0.5 * (F[c, i, j] + F[c, j, i]) - (1.0 if i == j else 0.0)
                square += strain * strain
                stress[c, i, j] = 2.0 * mu[c] * strain + (lam[c] * trace if i == j else 0.0)
        energy[c] = mu[c] * square + 0.5 * lam[c] * trace * trace
    return energy, stress


def _in_identities(dim: int, mu: Array, lam: Array) -> Array:
    identity = np.eye(dim)
    shear = np.einsum("ik,jl->ijkl", identity, identity) + np.einsum("il,jk->ijkl", identity, identity)
    volume = np.einsum("ij,kl->ijkl", identity, identity)
    return np.multiply.outer(mu, shear) + np.multiply.outer(lam, volume)


@compiled(reference=_in_identities)
def _tangent(dim: int, mu: Array, lam: Array) -> Array:
    """A (n, dim, dim, dim, dim)."""
    A = np.zeros((len(mu), dim, dim, dim, dim))
    for c in range(len(mu)):
        for i in range(dim):
            for j in range(dim):
                A[c, i, j, i, j] += mu[c]
                A[c, i, j, j, i] += mu[c]
                A[c, i, i, j, j] += lam[c]
    return A


MATERIAL = Linear
