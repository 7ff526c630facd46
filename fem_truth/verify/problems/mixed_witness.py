"""Nearly incompressible solids in scikit-fem with displacement and pressure (Taylor and Hood's quadrilaterals, Q2/Q1).

Of the energy mu/2 (J^(-2/3) I_C - 3) + kappa/4 (J^2 - 1 - 2 log J), the volumetric part is enforced through the
pressure p = kappa/2 (J - 1/J), which prevents locking for large kappa:

    integral (mu J^(-2/3) (F - I_C/3 F^-T) + p J F^-T) : grad v = load,     integral q ((J - 1/J)/2 - p/kappa) = 0.

Plane strain. Needs scikit-fem, as `fem_truth.verify.problems.witness` does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
import skfem
from scipy.sparse.linalg import spsolve
from skfem.helpers import ddot, det, grad, identity, inv, mul, transpose

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.errors import SoftprintError


class MixedWitness:
    """mesh: quadrilaterals of scikit-fem; mu, kappa [Pa]."""

    def __init__(self, mesh: Any, mu: float, kappa: float) -> None:
        self.u_basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
        self._p_basis = self.u_basis.with_element(skfem.ElementQuad1())
        self._mu, self._kappa = mu, kappa

    def solve(self, load: Array, free: IntArray, steps: int, tolerance: float = 1e-9) -> Array:
        """Displacements in scikit-fem's order, by Newton's method in equal steps of the load from rest."""
        n, m = self.u_basis.N, self._p_basis.N
        u, p = np.zeros(n), np.zeros(m)
        unknowns = np.concatenate([free, n + np.arange(m)])
        for share in np.linspace(1.0 / steps, 1.0, steps):
            for _ in range(20):
                force, gap, matrix = self._system(u, p)
                residual = np.concatenate([share * load - force, -gap])[unknowns]
                # the two parts have different units: forces and volumes
                if np.linalg.norm(residual[: len(free)]) < tolerance * np.linalg.norm(load):
                    break
                step = spsolve(matrix[unknowns][:, unknowns].tocsc(), residual)
                u[free] += step[: len(free)]
                p += step[len(free) :]
            else:
                raise SoftprintError(f"the mixed witness did not converge at {share:.0%} of the load")
        return u

    def _system(self, u: Array, p: Array) -> tuple[Array, Array, sp.csr_matrix]:
        """Residuals of both equations, and their derivative."""
        mu, kappa = self._mu, self._kappa
        fields = {"u": self.u_basis.interpolate(u), "p": self._p_basis.interpolate(p)}

        def kinematics(w: Any) -> tuple[Any, Any, Any, Any]:
            F = grad(w.u) + identity(grad(w.u))
            return F, det(F), transpose(inv(F)), ddot(F, F) + 1.0

        @skfem.LinearForm
        def force(v: Any, w: Any) -> Any:
            F, J, F_T, trace = kinematics(w)
            return ddot(mu * J ** (-2 / 3) * (F - trace / 3 * F_T) + w.p * J * F_T, grad(v))

        @skfem.LinearForm
        def gap(q: Any, w: Any) -> Any:
            _, J, _, _ = kinematics(w)
            return q * ((J - 1 / J) / 2 - w.p / kappa)

        @skfem.BilinearForm
        def stiffness(du: Any, v: Any, w: Any) -> Any:
            F, J, F_T, trace = kinematics(w)
            dF = grad(du)
            growth, across = ddot(F_T, dF), mul(mul(F_T, transpose(dF)), F_T)
            deviator = F - trace / 3 * F_T
            of_shape = dF - 2 / 3 * ddot(F, dF) * F_T + trace / 3 * across - 2 / 3 * growth * deviator
            return ddot(mu * J ** (-2 / 3) * of_shape + w.p * J * (growth * F_T - across), grad(v))

        @skfem.BilinearForm
        def pressed(dp: Any, v: Any, w: Any) -> Any:
            _, J, F_T, _ = kinematics(w)
            return dp * J * ddot(F_T, grad(v))

        @skfem.BilinearForm
        def swollen(du: Any, q: Any, w: Any) -> Any:
            _, J, F_T, _ = kinematics(w)
            return q * (J + 1 / J) / 2 * ddot(F_T, grad(du))

        @skfem.BilinearForm
        def compressed(dp: Any, q: Any, w: Any) -> Any:
            return -dp * q / kappa

        u_basis, p_basis = self.u_basis, self._p_basis
        matrix = sp.bmat(
            [
                [stiffness.assemble(u_basis, **fields), pressed.assemble(p_basis, u_basis, **fields)],
                [swollen.assemble(u_basis, p_basis, **fields), compressed.assemble(p_basis)],
            ],
            format="csr",
        )
        return force.assemble(u_basis, **fields), gap.assemble(p_basis, **fields), matrix
