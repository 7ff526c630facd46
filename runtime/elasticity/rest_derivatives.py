"""The third and fourth derivatives of the energy density of an elastic solid at rest, D3 and D4 of Psi at F = I.

A displacement gradient H, on top of a small stretch I + E of the solid (a small deformation on top of another: Biot
1965), has, less what is linear in it, the energy density

    Psi_2(H) + Psi_3(H) + Psi_4(H) + Q(H, E) + ...,

    Psi_3 = 1/6 D3[H, H, H],    Psi_4 = 1/24 D4[H, H, H, H],    Q = 1/2 D3[H, H, E] + 1/4 D4[H, H, E, E],

with Psi_2 that of linear elasticity. Every energy density here is linear in the Lamé moduli, and so are D3 and D4. They
are central differences of the tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import permutations
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.elasticity.material import Material
from softprint.runtime.elasticity.materials import make_material

# The strains of the differences.
_STEP, _STEP_OF_FOURTH = 1e-4, 1e-3


class _Derivatives(NamedTuple):
    """third: D3 (k, k k) and fourth: D4 (k k, k k), with k = dim^2."""

    third: Array
    fourth: Array


@dataclass(frozen=True, eq=False)
class RestDerivatives:
    """Of n cells, or of one solid. parts: Lamé moduli (n, 1) or (1, 1) [Pa], and the derivatives by each."""

    parts: tuple[tuple[Array, _Derivatives], ...]

    @classmethod
    def of(cls, material: Material, dim: int) -> RestDerivatives:
        """Of a material with moduli that are the same everywhere, or of one for each of n cells."""
        of_moduli = zip((material.lame_mu, material.lame_lambda), _by_moduli(material.model, dim), strict=True)
        parts = tuple((modulus.reshape(-1, 1), found) for modulus, found in of_moduli)
        if all(modulus.size == 1 for modulus, _ in parts):
            whole = (
                sum((modulus * of[k] for modulus, of in parts), np.zeros(())) for k in range(len(parts[0][1]))
            )
            return cls(((np.ones((1, 1)), _Derivatives(*whole)),))
        return cls(parts)

    def at(self, cells: IntArray) -> RestDerivatives:
        """Of some of the cells."""
        of = ((modulus if len(modulus) == 1 else modulus[cells], found) for modulus, found in self.parts)
        return RestDerivatives(tuple(of))

    def third_along(self, H: Array) -> Array:
        """D3[., ., H] (m, dim^2, dim^2) [Pa] along H (m, dim^2)."""
        found = self._summed([H @ of.third for _, of in self.parts])
        return found.reshape(-1, H.shape[1], H.shape[1])

    def fourth_along(self, H: Array, G: Array) -> Array:
        """D4[., ., H, G] (m, dim^2, dim^2) [Pa] along H and G (m, dim^2)."""
        both = (H[:, :, None] * G[:, None, :]).reshape(len(H), -1)
        found = self._summed([both @ of.fourth for _, of in self.parts])
        return found.reshape(-1, H.shape[1], H.shape[1])

    def _summed(self, products: list[Array]) -> Array:
        """Times the moduli; those of one solid are in its derivatives, see `of`."""
        if len(products) == 1:
            return products[0]
        return np.asarray(sum(modulus * part for (modulus, _), part in zip(self.parts, products, strict=True)))


@cache
def _by_moduli(model: str, dim: int) -> tuple[_Derivatives, _Derivatives]:
    """Those of a material with mu = 1 and lambda = 0, and what lambda = 1 adds."""
    of_mu = _differences(make_material(model, 2.0, 0.0), dim)
    of_both = _differences(make_material(model, 2.5, 0.25), dim)
    return of_mu, _Derivatives(*(both - mu for both, mu in zip(of_both, of_mu, strict=True)))


def _differences(material: Material, dim: int) -> _Derivatives:
    k, identity = dim**2, np.eye(dim)
    ways = np.eye(k).reshape(k, dim, dim)

    def tangents(change: Array) -> Array:
        return material.tangent(identity + change.reshape(-1, dim, dim)).reshape(*change.shape[:-2], k, k)

    third = (tangents(_STEP * ways) - tangents(-_STEP * ways)) / (2.0 * _STEP)
    both, apart = (_STEP_OF_FOURTH * (ways[:, None] + side * ways) for side in (1.0, -1.0))
    fourth = tangents(both) + tangents(-both) - tangents(apart) - tangents(-apart)
    fourth /= 4.0 * _STEP_OF_FOURTH**2
    return _Derivatives(_symmetric(third).reshape(k, k * k), _symmetric(fourth).reshape(k * k, k * k))


def _symmetric(of: Array) -> Array:
    """In all its axes, without the round-off of differences."""
    every = [of.transpose(order) for order in permutations(range(of.ndim))]
    return np.asarray(sum(every, np.zeros(())) / len(every))
