"""Linear elasticity, for small displacements."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.material import Material
from softprint.runtime.elasticity.tensor_products import stack


class Linear(Material):
    """Small-strain linear elasticity: Psi = mu eps:eps + lambda/2 (tr eps)^2 with eps = (F + F^T)/2 - I.

    Not invariant under rotations: for small displacements only.
    """

    model = "linear"
    rotation_invariant = False
    finite_if_inverted = True

    def energy_density(self, F: Array) -> Array:
        strain = _small_strain(F)
        trace = np.trace(strain, axis1=1, axis2=2)
        return self.mu * (strain * strain).sum(axis=(1, 2)) + 0.5 * self.lam * trace**2

    def first_piola(self, F: Array) -> Array:
        strain = _small_strain(F)
        trace = np.trace(strain, axis1=1, axis2=2)
        return 2.0 * stack(self.mu, len(F)) * strain + (self.lam * trace)[:, None, None] * np.eye(F.shape[-1])

    def tangent(self, F: Array) -> Array:
        identity = np.eye(F.shape[-1])
        shear = np.einsum("ik,jl->ijkl", identity, identity) + np.einsum("il,jk->ijkl", identity, identity)
        volume = np.einsum("ij,kl->ijkl", identity, identity)
        count = len(F)
        return (
            stack(self.mu, count)[:, :, :, None, None] * shear
            + stack(self.lam, count)[:, :, :, None, None] * volume
        )


def _small_strain(F: Array) -> Array:
    return 0.5 * (F + F.transpose(0, 2, 1)) - np.eye(F.shape[-1])


MATERIAL = Linear
