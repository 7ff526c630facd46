"""The interface of hyperelastic materials: energy density Psi(F) [J/m^dim], first Piola-Kirchhoff stress P, tangent.

F: (n, dim, dim) deformation gradients. P_ij = dPsi/dF_ij [Pa]; tangent A_ijkl = dP_ij/dF_kl [Pa]. In 2D
every law is *plane strain*: the 3D law with F_33 = 1 and no shear out of the plane. All are defined by
Young's modulus E and Poisson's ratio nu, and all have mu_L = E / (2 (1 + nu)), lambda_L = E nu / ((1 +
nu)(1 - 2 nu)) at small strain.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class Material(ABC):
    """young: E [Pa]; poisson: nu; each a scalar or (n,), one for each deformation gradient.

    model: the name in experiment files; rotation_invariant: Psi(R F) = Psi(F R) = Psi(F) for every rotation R;
    finite_if_inverted: Psi, P and the tangent are finite for every F, also where det F <= 0.
    """

    young: Array
    poisson: Array
    model: ClassVar[str]
    rotation_invariant: ClassVar[bool] = True
    finite_if_inverted: ClassVar[bool] = False

    @classmethod
    def from_young_poisson(cls, young: ArrayLike, poisson: ArrayLike) -> Self:
        """The material with these moduli. Raises SoftprintError unless E is positive and nu between -1 and 0.5
        (exclusive)."""
        young, poisson = np.asarray(young, dtype=np.float64), np.asarray(poisson, dtype=np.float64)
        if not (np.isfinite(young).all() and (young > 0).all()):
            raise SoftprintError(f"material: Young's modulus must be positive, it is {np.min(young)} Pa")
        if not ((poisson > -1) & (poisson < 0.5)).all():
            wrong = poisson[~((poisson > -1) & (poisson < 0.5))].flat[0]
            raise SoftprintError(
                f"material: Poisson's ratio must lie between -1 and 0.5 (exclusive), it is {wrong}"
            )
        return cls(young, poisson)

    def at(self, cells: IntArray | BoolArray | slice) -> Self:
        """The material of some of the cells only."""
        if not (self.young.ndim or self.poisson.ndim):
            return self
        return type(self)(
            self.young[cells] if self.young.ndim else self.young,
            self.poisson[cells] if self.poisson.ndim else self.poisson,
        )

    @cached_property
    def lame_mu(self) -> Array:
        """mu_L [Pa], the shear modulus at small strain."""
        return np.asarray(self.young / (2 * (1 + self.poisson)))

    @cached_property
    def lame_lambda(self) -> Array:
        """lambda_L [Pa] at small strain."""
        return np.asarray(self.young * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson)))

    @cached_property
    def mu(self) -> Array:
        """The mu of the model's own formula [Pa]; mu_L unless the model remaps it."""
        return self.lame_mu

    @cached_property
    def lam(self) -> Array:
        """The lambda of the model's own formula [Pa]; lambda_L unless the model remaps it."""
        return self.lame_lambda

    @abstractmethod
    def energy_density(self, F: Array) -> Array:
        """Psi (n,) [J/m^dim], zero at rest."""

    @abstractmethod
    def first_piola(self, F: Array) -> Array:
        """P (n, dim, dim) [Pa], zero at rest."""

    def energy_and_stress(self, F: Array) -> tuple[Array, Array]:
        """Psi and P, sharing their common terms."""
        return self.energy_density(F), self.first_piola(F)

    @abstractmethod
    def tangent(self, F: Array) -> Array:
        """A (n, dim, dim, dim, dim) [Pa] with A_ijkl = dP_ij/dF_kl = A_klij."""
