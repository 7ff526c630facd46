"""Hyperelastic materials: energy density Psi(F) [J/m^dim], first Piola-Kirchhoff stress P and its tangent.

F: (n, dim, dim) deformation gradients. P_ij = dPsi/dF_ij [Pa]; tangent A_ijkl = dP_ij/dF_kl [Pa]. In 2D
every law is *plane strain*: the 3D law with F_33 = 1 and no shear out of the plane. All are given by
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

from runtime.arrays import Array, BoolArray, IntArray
from runtime.compiled import compiled
from runtime.elasticity.invariants import cofactor, determinant, first_invariant
from runtime.elasticity.tangent_kernel import isotropic_tangent
from runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class Material(ABC):
    """young: E [Pa]; poisson: nu; each a scalar or (n,), one for each deformation gradient."""

    young: Array
    poisson: Array
    model: ClassVar[str]

    @classmethod
    def from_young_poisson(cls, young: ArrayLike, poisson: ArrayLike) -> Self:
        """Refuses values no isotropic solid has: E must be positive, nu between -1 and 0.5 (exclusive)."""
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

    @property
    def mu(self) -> Array:
        """The mu of the model's own formula [Pa]; mu_L unless the model remaps it."""
        return self.lame_mu

    @property
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
        """Both at once."""
        return self.energy_density(F), self.first_piola(F)

    @abstractmethod
    def tangent(self, F: Array) -> Array:
        """A (n, dim, dim, dim, dim) [Pa] with A_ijkl = dP_ij/dF_kl = A_klij."""


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

    @cached_property
    def _mu(self) -> Array:
        return np.asarray(4.0 / 3.0 * self.lame_mu)

    @cached_property
    def _lam(self) -> Array:
        return np.asarray(self.lame_lambda + 5.0 / 6.0 * self.lame_mu)

    @property
    def mu(self) -> Array:
        return self._mu

    @property
    def lam(self) -> Array:
        return self._lam

    def energy_density(self, F: Array) -> Array:
        return self.energy_and_stress(F)[0]

    def first_piola(self, F: Array) -> Array:
        return self.energy_and_stress(F)[1]

    def energy_and_stress(self, F: Array) -> tuple[Array, Array]:
        mu, lam = np.broadcast_to(self.mu, len(F)), np.broadcast_to(self.lam, len(F))
        return _stable_energy_and_stress(F, cofactor(F), mu, lam)

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


@compiled
def _stable_energy_and_stress(F: Array, dJ: Array, mu: Array, lam: Array) -> tuple[Array, Array]:
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


class NeoHookean(Material):
    """Neo-Hookean with logarithmic volume term (Bonet and Wood 1997, eq. 6.28):

    Psi = mu/2 (F:F - dim) - mu log J + lambda/2 (log J)^2,    mu = mu_L, lambda = lambda_L.

    P = mu F + (lambda log J - mu) F^-T. Infinite for J <= 0 (a line search never accepts such a step),
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
        inverse_transpose, log_J = _inverse_transpose(F)
        return _stack(self.mu, len(F)) * F + (self.lam * log_J - self.mu)[:, None, None] * inverse_transpose

    def tangent(self, F: Array) -> Array:
        inverse_transpose, log_J = _inverse_transpose(F)
        result = (self.mu - self.lam * log_J)[:, None, None, None, None] * _crossed(inverse_transpose)
        result += _outer(inverse_transpose, self.lam)
        return _add_identity(result, self.mu)


class IsochoricNeoHookean(Material):
    """Neo-Hookean in the volume-preserving part of the deformation (Simo and Miehe 1992; Holzapfel 2000, sec. 6.4):

    Psi = mu/2 (J^(-2/3) I_C - 3) + kappa/4 (J^2 - 1 - 2 log J),    mu = mu_L, kappa = lambda_L + 2/3 mu_L.

    P = mu J^(-2/3) (F - I_C/3 F^-T) + kappa/2 (J^2 - 1) F^-T. Shape and volume are told apart: the pressure depends
    on J alone, which suits nearly incompressible solids. Infinite for J <= 0, as the law above.
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
        inverse_transpose, log_J = _inverse_transpose(F)
        shear = self.mu * np.exp(-2.0 / 3.0 * log_J)
        pressure = 0.5 * self.bulk * np.expm1(2.0 * log_J)
        spherical = pressure - shear * first_invariant(F) / 3.0
        return shear[:, None, None] * F + spherical[:, None, None] * inverse_transpose

    def tangent(self, F: Array) -> Array:
        inverse_transpose, log_J = _inverse_transpose(F)
        shear, trace = self.mu * np.exp(-2.0 / 3.0 * log_J), first_invariant(F)
        pressure = 0.5 * self.bulk * np.expm1(2.0 * log_J)
        result = (shear * trace / 3.0 - pressure)[:, None, None, None, None] * _crossed(inverse_transpose)
        volume = self.bulk * np.exp(2.0 * log_J) + 2.0 / 9.0 * shear * trace
        result += _outer(inverse_transpose, volume)
        # F (x) F^-T + F^-T (x) F, each symmetric in the exchange of both
        mixed: Array = F[:, :, :, None, None] * inverse_transpose[:, None, None, :, :]
        mixed = mixed + mixed.transpose(0, 3, 4, 1, 2)
        result -= (2.0 / 3.0 * shear)[:, None, None, None, None] * mixed
        return _add_identity(result, shear)


class Linear(Material):
    """Small-strain linear elasticity: Psi = mu eps:eps + lambda/2 (tr eps)^2 with eps = (F + F^T)/2 - I.

    Not invariant to rotations: for small displacements only.
    """

    model = "linear"

    def energy_density(self, F: Array) -> Array:
        strain = _small_strain(F)
        trace = np.trace(strain, axis1=1, axis2=2)
        return self.mu * (strain * strain).sum(axis=(1, 2)) + 0.5 * self.lam * trace**2

    def first_piola(self, F: Array) -> Array:
        strain = _small_strain(F)
        trace = np.trace(strain, axis1=1, axis2=2)
        return 2.0 * _stack(self.mu, len(F)) * strain + (self.lam * trace)[:, None, None] * np.eye(
            F.shape[-1]
        )

    def tangent(self, F: Array) -> Array:
        identity = np.eye(F.shape[-1])
        shear = np.einsum("ik,jl->ijkl", identity, identity) + np.einsum("il,jk->ijkl", identity, identity)
        volume = np.einsum("ij,kl->ijkl", identity, identity)
        count = len(F)
        return (
            _stack(self.mu, count)[:, :, :, None, None] * shear
            + _stack(self.lam, count)[:, :, :, None, None] * volume
        )


_MODELS: dict[str, type[Material]] = {
    kind.model: kind for kind in (StableNeoHookean, NeoHookean, IsochoricNeoHookean, Linear)
}


def make_material(model: str, young: ArrayLike, poisson: ArrayLike) -> Material:
    """The material of that model name; young [Pa] and poisson are scalars or (n_cells,)."""
    if model not in _MODELS:
        raise SoftprintError(f"material: unknown model {model!r}; known are {', '.join(_MODELS)}")
    return _MODELS[model].from_young_poisson(young, poisson)


def _inverse_transpose(F: Array) -> tuple[Array, Array]:
    """F^-T and log J; NaN where J <= 0."""
    J = determinant(F)
    with np.errstate(invalid="ignore", divide="ignore"):
        return cofactor(F) / np.where(J > 0, J, np.nan)[:, None, None], np.log(np.where(J > 0, J, np.nan))


def _crossed(inverse_transpose: Array) -> Array:
    """F^-T_il F^-T_kj = -dF^-T_ij / dF_kl, (n, dim, dim, dim, dim)."""
    crossed: Array = (
        inverse_transpose[:, :, None, None, :] * inverse_transpose.transpose(0, 2, 1)[:, None, :, :, None]
    )
    return crossed


def _small_strain(F: Array) -> Array:
    return 0.5 * (F + F.transpose(0, 2, 1)) - np.eye(F.shape[-1])


def _stack(value: Array, count: int) -> Array:
    """A scalar or (n,) as (n, 1, 1)."""
    return np.broadcast_to(value, (count,))[:, None, None]


def _outer(M: Array, factor: Array) -> Array:
    """factor M_ij M_kl, (n, dim, dim, dim, dim)."""
    flat = M.reshape(len(M), -1)
    scaled = np.broadcast_to(factor, (len(M),))[:, None] * flat
    return (scaled[:, :, None] * flat[:, None, :]).reshape(M.shape + M.shape[1:])


def _add_identity(tangent: Array, factor: Array) -> Array:
    """tangent_ijkl += factor delta_ik delta_jl, in place."""
    diagonal = np.einsum("nijij->nij", tangent)  # a view
    diagonal += np.broadcast_to(factor, (len(tangent),))[:, None, None]
    return tangent
