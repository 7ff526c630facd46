"""Strain energy densities as UFL expressions for FFCx: the same formulas as in `runtime.elasticity.materials`.

To add one, write a function with the name of the model, decorated with `_density`.

F is the deformation gradient (dim x dim, plane strain in 2D), mu and lam are the two moduli [Pa] in the model's
formula (`Material.mu` and `Material.lam`: Lame's, remapped if the model needs it). In plane strain the third stretch
is 1, so tr C gains 1 and J is unchanged; all energies vanish at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ufl

from softprint.runtime.elasticity.materials.invertible_neo_hookean import CONTINUED
from softprint.runtime.errors import SoftprintError

Density = Callable[[Any, Any, Any], Any]

#: psi(F, mu, lam) [Pa] of every material, by its model name.
DENSITIES: dict[str, Density] = {}


def _density(function: Density) -> Density:
    DENSITIES[function.__name__] = function
    return function


@_density
def stable_neo_hookean(F: Any, mu: Any, lam: Any) -> Any:
    """Smith et al. 2018: mu/2 (I_C - 3) - mu/2 log((I_C + 1)/4) - 3/4 mu (J - 1) + lam/2 (J - 1)^2."""
    strain, volume = _strain(F), ufl.det(F) - 1.0
    return mu * (0.5 * strain - 0.5 * ufl.ln(1.0 + 0.25 * strain) - 0.75 * volume) + 0.5 * lam * volume**2


@_density
def neo_hookean(F: Any, mu: Any, lam: Any) -> Any:
    """psi = mu/2 (I_C - 3) - mu log J + lam/2 (log J)^2; not a number where J <= 0."""
    log_J = ufl.ln(ufl.det(F))
    return mu / 2.0 * _strain(F) - mu * log_J + lam / 2.0 * log_J**2


@_density
def invertible_neo_hookean(F: Any, mu: Any, lam: Any) -> Any:
    """psi = mu/2 (I_C - 3) - mu l + lam/2 l^2, l = log m + d - d^2/2, m = max(J, J_0), d = min(J - J_0, 0)/J_0."""
    J = ufl.det(F)
    d = ufl.min_value(J - CONTINUED, 0.0) / CONTINUED
    log_J = ufl.ln(ufl.max_value(J, CONTINUED)) + d - 0.5 * d**2
    return mu / 2.0 * _strain(F) - mu * log_J + lam / 2.0 * log_J**2


@_density
def isochoric_neo_hookean(F: Any, mu: Any, lam: Any) -> Any:
    """psi = mu/2 (J^(-2/3) I_C - 3) + kappa/4 (J^2 - 1 - 2 log J), kappa = lam + 2/3 mu; not a number where J <= 0."""
    J, kappa = ufl.det(F), lam + 2.0 / 3.0 * mu
    shape = J ** (-2.0 / 3.0) * (_strain(F) + 3.0) - 3.0
    return mu / 2.0 * shape + kappa / 4.0 * (J**2 - 1.0 - 2.0 * ufl.ln(J))


@_density
def linear(F: Any, mu: Any, lam: Any) -> Any:
    """psi = mu e:e + lam/2 (tr e)^2 with the small strain e = sym F - I: not rotation invariant."""
    strain = ufl.sym(F) - ufl.Identity(F.ufl_shape[0])
    return mu * ufl.inner(strain, strain) + lam / 2.0 * ufl.tr(strain) ** 2


def energy_density(model: str, F: Any, mu: Any, lam: Any) -> Any:
    """psi [Pa] of the named material model; raises SoftprintError for an unknown name."""
    if model not in DENSITIES:
        raise SoftprintError(
            f"no UFL form for the material model {model!r}; there are: {', '.join(DENSITIES)}"
        )
    return DENSITIES[model](F, mu, lam)


def _strain(F: Any) -> Any:
    """I_C - 3 of the three-dimensional deformation gradient: tr(F^T F) - dim, the third stretch of plane
    strain being 1."""
    return ufl.inner(F, F) - F.ufl_shape[0]
