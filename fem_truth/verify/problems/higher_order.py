"""Softprint's energies on higher-order elements, for problems that linear elements cannot solve.

The forms are those of `fem_truth.elasticity.energy_densities`, the spaces DOLFINx's, the solver Newton's
method with a sparse factorisation (MUMPS): small problems only.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem
from petsc4py import PETSc

from softprint.fem_truth.elasticity import dolfinx_version as dfx
from softprint.fem_truth.elasticity.energy_densities import energy_density
from softprint.fem_truth.verify.problems.equilibrium import Solid
from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.errors import SoftprintError

#: A linear form of a test function v and the position X, as UFL: the work of a load [J].
Load = Callable[[ufl.Argument, ufl.SpatialCoordinate], ufl.Form]

_ITERATIONS = 12  # iterations of Newton's method: more mean that the load step is too large
_SMALLEST_STEP = 1e-3


class HigherOrderElasticity:
    """W(u) of a solid of one material, with displacements of the given degree.

    nodes: (n, dim) positions of the unknowns; load: (n, dim) [N] nodal loads.
    """

    def __init__(self, solid: Solid, degree: int, load: Load, quadrature_degree: int = 4) -> None:
        dim = solid.mesh.dim
        with dfx.quiet_compiler():
            self.domain = dfx.make_mesh(solid.mesh)
            self.space = dfx.vector_space(self.domain, dim, degree)
            self.u = fem.Function(self.space)
            v = ufl.TestFunction(self.space)
            mu, lam = (
                fem.Constant(self.domain, float(value)) for value in (solid.material.mu, solid.material.lam)
            )
            F = ufl.Identity(dim) + ufl.grad(self.u)
            dx = ufl.dx(self.domain, metadata={"quadrature_degree": quadrature_degree})
            gradient = ufl.derivative(energy_density(solid.material.model, F, mu, lam) * dx, self.u, v)
            self._gradient = dfx.VectorAssembler(dfx.compile_form(gradient))
            self._hessian = dfx.BlockMatrixAssembler(dfx.compile_form(ufl.derivative(gradient, self.u)))
            work = dfx.compile_form(load(v, ufl.SpatialCoordinate(self.domain)))
        self.load = dfx.VectorAssembler(work)().copy().reshape(-1, dim)
        self.nodes = np.asarray(self.space.tabulate_dof_coordinates())[:, :dim]

    def solve(self, held: BoolArray, start: Array, tolerance: float = 1e-9) -> Array:
        """Displacements (n, dim) in equilibrium; components in the mask held (n, dim) keep their values in `start`.

        The load is applied in steps, halved if Newton's method does not converge. tolerance: of the residual,
        relative to the forces. Raises SoftprintError if steps of a thousandth of the load do not converge.
        """
        free = np.flatnonzero(~held.ravel())
        u, share, step = start.ravel(), 0.0, 1.0
        while share < 1.0:
            target = min(1.0, share + step)
            reached = self._newton(u, free, target, tolerance)
            if reached is not None:
                u, share, step = reached, target, 2.0 * step
            elif step < _SMALLEST_STEP:
                raise SoftprintError(f"no equilibrium was found beyond {share:.1%} of the load")
            else:
                step *= 0.5
        self.u.x.array[:] = u
        return u.reshape(start.shape)

    def _newton(self, start: Array, free: IntArray, share: float, tolerance: float) -> Array | None:
        """Displacements in equilibrium with this share of the load; None without convergence."""
        u, load = start.copy(), share * self.load.ravel()
        for _ in range(_ITERATIONS):
            force = self._force(u)
            residual = (load - force)[free]
            scale = max(float(np.linalg.norm(force)), float(np.linalg.norm(load)))
            if not np.isfinite(scale):
                return None
            if np.linalg.norm(residual) <= tolerance * scale:
                return u
            u[free] += _solved(self._stiffness()[free][:, free], residual)
        return None

    def norm(self, difference: Callable[[ufl.SpatialCoordinate], ufl.core.expr.Expr], degree: int) -> float:
        """The L2 norm of an expression of the position X (which may use `u`), by a quadrature of this degree."""
        with dfx.quiet_compiler():
            value = difference(ufl.SpatialCoordinate(self.domain))
            dx = ufl.dx(self.domain, metadata={"quadrature_degree": degree})
            form = dfx.compile_form(ufl.inner(value, value) * dx)
        return float(np.sqrt(dfx.assemble_scalar(form)))

    def _force(self, u: Array) -> Array:
        self.u.x.array[:] = u
        return self._gradient().copy()

    def _stiffness(self) -> sp.csr_matrix:
        """Stiffness at the displacements of the last call of `_force`."""
        self._hessian.assemble()
        size = self.u.x.array.size
        blocks = (self._hessian.blocks(), self._hessian.columns, self._hessian.row_starts)
        return sp.bsr_matrix(blocks, shape=(size, size)).tocsr()


def _solved(matrix: sp.csr_matrix, right: Array) -> Array:
    """matrix^-1 right."""
    petsc = PETSc.Mat().createAIJ(matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data))
    solver = PETSc.KSP().create(PETSc.COMM_SELF)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")
    solver.setOperators(petsc)
    solution = petsc.createVecRight()
    solver.solve(PETSc.Vec().createWithArray(right), solution)
    result = np.array(solution.array_r)
    for thing in (solver, petsc, solution):
        thing.destroy()
    return result
