"""An independent reference: scikit-fem assembles and solves what Softprint does with UFL, FFCx and DOLFINx.

Stresses and their derivatives are written out by hand here, in the tensors of the textbook (Bonet and Wood 1997, sec.
6.4; Smith et al. 2018; Holzapfel 2000, sec. 6.4), so that they depend neither on UFL's differentiation nor on FFCx:

    neo-Hookean         P = mu (F - F^-T) + lam log J F^-T
    stable neo-Hookean  P = mu (1 - 1/(I_C + 1)) F + (lam (J - 1) - 3/4 mu) J F^-T
    isochoric           P = mu J^(-2/3) (F - I_C/3 F^-T) + kappa/2 (J^2 - 1) F^-T

This module needs scikit-fem, a development dependency; nothing else in Softprint does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
import skfem
from numpy.typing import ArrayLike
from scipy.sparse.linalg import spsolve
from skfem.helpers import ddot, det, grad, identity, inv, mul, transpose

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

#: P at (F, mu, lam), and dP as a function of dF; mu and lam are Lame's.
Law = Callable[[Any, Any, Any], tuple[Any, Callable[[Any], Any]]]


def neo_hookean(F: Any, mu: Any, lam: Any) -> tuple[Any, Callable[[Any], Any]]:
    """Bonet and Wood's compressible law."""
    F_T, log_J = transpose(inv(F)), np.log(det(F))

    def change(dF: Any) -> Any:
        return mu * dF + (mu - lam * log_J) * _across(F_T, dF) + lam * ddot(F_T, dF) * F_T

    return mu * (F - F_T) + lam * log_J * F_T, change


def stable_neo_hookean(F: Any, mu: Any, lam: Any) -> tuple[Any, Callable[[Any], Any]]:
    """Smith's law; E and nu are exact at small strain with mu and lam remapped."""
    mu, lam = 4 / 3 * mu, lam + 5 / 6 * mu
    F_T, J = transpose(inv(F)), det(F)
    trace = _trace(F) + 1.0
    pressure = lam * (J - 1.0) - 0.75 * mu

    def change(dF: Any) -> Any:
        growth = ddot(F_T, dF)  # dJ / J
        return (
            mu * (1.0 - 1.0 / trace) * dF
            + 2.0 * mu * ddot(F, dF) / trace**2 * F
            + J * (lam * J * growth * F_T + pressure * (growth * F_T - _across(F_T, dF)))
        )

    return mu * (1.0 - 1.0 / trace) * F + pressure * J * F_T, change


def isochoric_neo_hookean(F: Any, mu: Any, lam: Any) -> tuple[Any, Callable[[Any], Any]]:
    """Split into isochoric and volumetric parts; kappa = lam + 2/3 mu."""
    F_T, J, trace = transpose(inv(F)), det(F), _trace(F)
    shear, kappa = mu * J ** (-2 / 3), lam + 2 / 3 * mu
    deviator = F - trace / 3 * F_T

    def change(dF: Any) -> Any:
        growth, across = ddot(F_T, dF), _across(F_T, dF)
        of_shape = dF - 2 / 3 * ddot(F, dF) * F_T + trace / 3 * across - 2 / 3 * growth * deviator
        return shear * of_shape + kappa * J**2 * growth * F_T - kappa / 2 * (J**2 - 1) * across

    return shear * deviator + kappa / 2 * (J**2 - 1) * F_T, change


LAWS: dict[str, Law] = {law.__name__: law for law in (stable_neo_hookean, neo_hookean, isochoric_neo_hookean)}


def _across(F_T: Any, dF: Any) -> Any:
    """-d(F^-T)."""
    return mul(mul(F_T, transpose(dF)), F_T)


def _trace(F: Any) -> Any:
    """I_C, with a third stretch of 1 in plane strain."""
    return ddot(F, F) + (3 - len(F))


class Witness:
    """A body in scikit-fem, with one unknown for each (node, axis), in this order.

    young, poisson: scalars or (n_cells,); law: the name of the material model.
    """

    def __init__(self, mesh: Mesh, young: ArrayLike, poisson: ArrayLike, law: str) -> None:
        element = skfem.ElementTriP1() if mesh.dim == 2 else skfem.ElementTetP1()
        kind = skfem.MeshTri if mesh.dim == 2 else skfem.MeshTet
        basis = skfem.Basis(
            kind(mesh.points.T.copy(), mesh.cells.T.copy()), skfem.ElementVector(element), intorder=1
        )
        cells = np.ones(mesh.n_cells)
        self._body = WitnessBody(basis, np.asarray(young) * cells, np.asarray(poisson) * cells, law)
        self._dofs = basis.nodal_dofs.T  # (n_nodes, dim)
        self._rest = mesh.points

    def forces(self, x: Array) -> Array:
        """dW/dx (n_nodes, dim) [N]."""
        return self._body.forces(self._unknowns(x))[self._dofs]

    def stiffness(self, x: Array) -> sp.csr_matrix:
        """d2W/dx2 [N/m] over (node, axis)."""
        order = self._dofs.ravel()
        return self._body.stiffness(self._unknowns(x))[order][:, order]

    def solve(self, load: Array, clamped: IntArray, steps: int = 10) -> Array:
        """Positions (n_nodes, dim) under nodal forces (n_nodes, dim) [N], with the nodes `clamped` fixed at rest."""
        right = np.empty(self._dofs.size)
        right[self._dofs] = load
        free = np.delete(self._dofs, clamped, axis=0).ravel()
        return self._rest + self._body.solve(right, free, steps)[self._dofs]

    def weight(self, force: Sequence[float] | Array) -> Array:
        """(n_nodes, dim) [N] of a body force [N/m^dim]."""

        @skfem.LinearForm
        def work(v: Any, w: Any) -> Any:
            return sum(component * v[axis] for axis, component in enumerate(force))

        return np.asarray(work.assemble(self._body.basis)[self._dofs])

    def _unknowns(self, x: Array) -> Array:
        u = np.empty(self._dofs.size)
        u[self._dofs] = x - self._rest
        return u


class WitnessBody:
    """Any displacement elements of scikit-fem with a material law; unknowns in scikit-fem's order. young, poisson:
    (n_cells,)."""

    def __init__(self, basis: Any, young: Array, poisson: Array, law: str) -> None:
        stress = LAWS[law]
        self.basis = basis
        moduli = {
            "mu": young / (2 * (1 + poisson)),
            "lam": young * poisson / ((1 + poisson) * (1 - 2 * poisson)),
        }
        self._moduli = {name: values[:, None] for name, values in moduli.items()}

        def deformation(w: Any) -> Any:
            return grad(w.u) + identity(grad(w.u))

        @skfem.LinearForm
        def forces(v: Any, w: Any) -> Any:
            return ddot(stress(deformation(w), w.mu, w.lam)[0], grad(v))

        @skfem.BilinearForm
        def stiffness(du: Any, v: Any, w: Any) -> Any:
            return ddot(stress(deformation(w), w.mu, w.lam)[1](grad(du)), grad(v))

        self._forces, self._stiffness = forces, stiffness

    def forces(self, u: Array) -> Array:
        """dW/du."""
        return self._assembled(self._forces, u)

    def stiffness(self, u: Array) -> sp.csr_matrix:
        """d2W/du2."""
        return self._assembled(self._stiffness, u)

    def solve(self, load: Array, free: IntArray, steps: int, tolerance: float = 1e-10) -> Array:
        """Newton's method from rest in equal load steps, each to the tolerance relative to its load."""
        u = np.zeros(self.basis.N)
        for share in np.linspace(1.0 / steps, 1.0, steps):
            for _ in range(20):
                residual = (share * load - self.forces(u))[free]
                if np.linalg.norm(residual) < tolerance * np.linalg.norm(share * load):
                    break
                u[free] += spsolve(self.stiffness(u)[free][:, free].tocsc(), residual)
            else:
                raise SoftprintError(f"the witness did not converge at {share:.0%} of the load")
        return u

    def _assembled(self, form: Any, u: Array) -> Any:
        return form.assemble(self.basis, u=self.basis.interpolate(u), **self._moduli)
