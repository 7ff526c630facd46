"""The stiffness of an elastic solid under a small strain: third derivatives of its energy density at rest.

A displacement gradient H on top of a strain E of the solid has, less what is linear in it and to first order in E (a
small deformation on top of another: Biot 1965), the energy density

    Psi_2(H) + Q(H, E),    Q = 1/2 H : B(E) : H,    B(E) = D3Psi(I)[., ., E],

with Psi_2 that of linear elasticity at rest. Every energy density here is linear in the Lamé moduli, and so is B. The
third derivatives are central differences of the tangent.

A strain is given by its components on and above the diagonal (n_strains(dim),), in the order of `np.triu_indices`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.elasticity.material import Material
from softprint.runtime.elasticity.materials import make_material

# The strain of the differences.
_STEP = 1e-4


def strain_components(dim: int) -> tuple[IntArray, IntArray]:
    """The rows and columns (s,) of the components of a strain."""
    return np.triu_indices(dim)


def n_strains(dim: int) -> int:
    """s, the number of components of a strain."""
    return dim * (dim + 1) // 2


@dataclass(frozen=True, eq=False)
class StrainedStiffness:
    """B of n cells, or of one solid. parts: Lamé moduli (n, 1) or (1, 1) [Pa], and by each dB/dE (s, dim^2 * dim^2)."""

    parts: tuple[tuple[Array, Array], ...]

    @classmethod
    def of(cls, material: Material, dim: int) -> StrainedStiffness:
        """Of a material with moduli that are the same everywhere, or of one for each of n cells."""
        of_moduli = zip((material.lame_mu, material.lame_lambda), _third_derivatives(material.model, dim), strict=True)
        parts = tuple((modulus.reshape(-1, 1), third) for modulus, third in of_moduli)
        if all(modulus.size == 1 for modulus, _ in parts):
            return cls(((np.ones((1, 1)), sum((modulus * third for modulus, third in parts), np.zeros(()))),))
        return cls(parts)

    def at(self, cells: IntArray) -> StrainedStiffness:
        """Of some of the cells."""
        of = ((modulus if len(modulus) == 1 else modulus[cells], third) for modulus, third in self.parts)
        return StrainedStiffness(tuple(of))

    def stiffness(self, strain: Array) -> Array:
        """B (m, dim^2, dim^2) [Pa] at strains E (m, s)."""
        found = sum((modulus * (strain @ third) for modulus, third in self.parts), np.zeros(()))
        size = int(np.sqrt(found.shape[1]))
        return np.asarray(found.reshape(-1, size, size))

    def by_strain(self, H: Array) -> tuple[Array, Array]:
        """dQ/dE (m, s) and d2Q/dE dH (m, s, dim^2) at displacement gradients H (m, dim^2)."""
        m, size = H.shape
        mixed = np.zeros(())
        for modulus, third in self.parts:
            by_H = third.reshape(-1, size) @ H.T  # (s dim^2, m)
            mixed = mixed + modulus[..., None] * by_H.reshape(-1, size, m).transpose(2, 0, 1)
        return 0.5 * (mixed @ H[..., None])[..., 0], mixed


@cache
def _third_derivatives(model: str, dim: int) -> tuple[Array, Array]:
    """dB/dE (s, dim^2 dim^2) of a material with mu = 1 and lambda = 0, and of what lambda = 1 adds."""
    of_mu = _differences(make_material(model, 2.0, 0.0), dim)
    return of_mu, _differences(make_material(model, 2.5, 0.25), dim) - of_mu


def _differences(material: Material, dim: int) -> Array:
    ways = np.zeros((n_strains(dim), dim, dim))
    for way, a, b in zip(ways, *strain_components(dim), strict=True):
        way[a, b] = way[b, a] = 1.0
    ahead, behind = (material.tangent(np.eye(dim) + side * _STEP * ways) for side in (1.0, -1.0))
    return np.asarray((ahead - behind).reshape(len(ways), -1) / (2.0 * _STEP))
