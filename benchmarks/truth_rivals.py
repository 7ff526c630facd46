"""Two other ways to solve for truth samples, as rivals of `fem_truth.statics.constrained`: the straightforward
one, and that of the thesis.

Both are given the same energy, the same tolerances and the same path (each depth starts where the last one ended),
which is more than either asks for.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc
from scipy.linalg import cho_factor, cho_solve

from benchmarks.stopwatch import Stopwatch
from softprint.fem_truth.elasticity.form_elasticity import FormElasticity
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one sample took, and came to: x (n_nodes, dim)."""

    x: Array
    converged: bool
    newton: int
    cg: int
    seconds: float


class Rival:
    """Newton's method with stock assembly: DOLFINx assembles the energy's derivatives from their UFL forms at every
    iteration, numpy adds a penalty contact."""

    def __init__(self, body: ReducedBody, gravity: Array, contact: PenaltyContact, watch: Stopwatch) -> None:
        self.body, self.contact, self.watch = body, contact, watch
        self.elasticity = FormElasticity(body.mesh, body.material)
        self.weight = body.node_mass[:, None] * gravity
        self.free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
        self.unknowns = (self.free[:, None] * body.dim + np.arange(body.dim)).ravel()
        self.basis = body.constraint_basis[self.free]
        self.gram = cho_factor(self.basis.T @ self.basis)

    def press(
        self, collider: Collider, poses: list[RigidPose], internal: Array, settings: FullSpaceSettings
    ) -> list[Outcome]:
        """From shallow to deep, up to the first depth that fails."""
        outcomes: list[Outcome] = []
        for pose in poses:
            start = outcomes[-1].x if outcomes else internal
            outcomes.append(self.solve(collider, pose, start, internal, settings))
            if not outcomes[-1].converged:
                break
        return outcomes

    def solve(
        self, collider: Collider, pose: RigidPose, x: Array, internal: Array, settings: FullSpaceSettings
    ) -> Outcome:
        """To the same residual, relative to the contact force, and the same decrement as `fem_truth.statics.newton`."""
        start, cg_total, converged, iteration = time.process_time(), 0, False, 0
        energy, gradient, scales, hessian = self._evaluate(collider, pose, x, internal)
        while iteration < settings.newton.max_iterations:
            iteration += 1
            step, cg = self._step(hessian(), gradient)
            cg_total += cg
            length, slope = 1.0, float(np.vdot(gradient, step))
            while True:
                trial = x.copy()
                trial[self.free] += length * step
                value, gradient, scales, hessian = self._evaluate(collider, pose, trial, internal)
                if self._accepts(value, energy, length * slope) or length < 1e-4:
                    break
                length *= 0.5
            x, energy = trial, value
            residual = float(np.linalg.norm(self._projected(gradient))) / scales[0]
            decrement = abs(0.5 * slope) / scales[1]
            if not np.isfinite(residual):
                break
            if residual <= settings.newton.tolerance and decrement <= settings.decrement_tolerance:
                converged = True
                break
        return Outcome(x, converged, iteration, cg_total, time.process_time() - start)

    def _evaluate(
        self, collider: Collider, pose: RigidPose, x: Array, internal: Array
    ) -> tuple[float, Array, tuple[float, float], Any]:
        """Energy; gradient on the free nodes; scales of forces and energies; the Hessian, to be assembled when asked
        for."""
        mesh = self.body.mesh
        with self.watch.timed("energy"):
            energy, gradient = self.elasticity.energy_gradient(x)
        with self.watch.timed("contact"):
            terms = self.contact.terms(x[mesh.surface_nodes], mesh.surface_areas, collider, pose)
        touching = mesh.surface_nodes[terms.index]
        energy += terms.energy - float(np.vdot(self.weight, x))
        gradient = gradient - self.weight
        gradient[touching] += terms.gradient
        force = np.zeros_like(gradient)
        force[touching] = terms.gradient
        work = abs(float(np.vdot(terms.gradient, (x - internal)[touching])))
        scales = max(float(np.linalg.norm(self._projected(force[self.free]))), 1e-9), max(work, 1e-12)

        def hessian() -> sp.csr_matrix:
            with self.watch.timed("assembly"):
                matrix = self.elasticity.hessian(x)
                matrix.add_diagonal(touching, terms.hessian)
                return matrix.sparse()[self.unknowns][:, self.unknowns]

        return energy, gradient[self.free], scales, hessian

    def _projected(self, v: Array) -> Array:
        """P v = v - U (U^T U)^-1 U^T v on the free nodes, by the Cholesky factor of U^T U (thesis 5.3.3)."""
        return v - self.basis @ cho_solve(self.gram, self.basis.T @ v)

    def _accepts(self, value: float, energy: float, slope: float) -> bool:
        raise NotImplementedError

    def _step(self, hessian: sp.csr_matrix, gradient: Array) -> tuple[Array, int]:
        """The Newton step on the free nodes, and the iterations of CG that it took."""
        raise NotImplementedError


class NaiveSolver(Rival):
    """The straightforward way: Lagrange multipliers, MUMPS factorises the whole saddle-point matrix at every iteration,
    and every step is taken whole, as DOLFINx's NewtonSolver takes it."""

    def _accepts(self, value: float, energy: float, slope: float) -> bool:
        return True

    def _step(self, hessian: sp.csr_matrix, gradient: Array) -> tuple[Array, int]:
        with self.watch.timed("factorisation"):
            border = sp.kron(self.basis, sp.identity(self.body.dim), format="csr")
            count = border.shape[1]
            # MUMPS wants an entry on every place of the diagonal.
            saddle = sp.bmat([[hessian, border], [border.T, sp.csr_matrix((count, count))]], format="csr")
            saddle = (
                saddle + sp.csr_matrix((np.zeros(saddle.shape[0]), (range(saddle.shape[0]),) * 2))
            ).tocsr()
            matrix = PETSc.Mat().createAIJ(
                saddle.shape,
                csr=(saddle.indptr.astype(np.int32), saddle.indices.astype(np.int32), saddle.data),
                comm=PETSc.COMM_SELF,
            )
            solver = PETSc.KSP().create(PETSc.COMM_SELF)
            solver.setOperators(matrix)
            solver.setType("preonly")
            solver.getPC().setType("lu")
            solver.getPC().setFactorSolverType("mumps")
            right = matrix.createVecRight()
            right.array[:] = np.concatenate([-gradient.ravel(), np.zeros(count)])
            solution = right.duplicate()
            solver.solve(right, solution)
            step = solution.array[: gradient.size].reshape(gradient.shape).copy()
            for made in (solver, matrix, right, solution):
                made.destroy()
        return step, 0


class ThesisSolver(Rival):
    """The thesis's way (5.3.3): the modified conjugate gradient method of Ascher and Boxerman with P as projection
    matrix, in every step of Newton's method. The preconditioner is theirs, the diagonal; the thesis does not say how
    far it solves, so to 1e-3, with a line search and a stop at negative curvature."""

    tolerance = 1e-3

    def _accepts(self, value: float, energy: float, slope: float) -> bool:
        return bool(value <= energy + 1e-4 * slope + 1e-12 * abs(energy))

    def _step(self, hessian: sp.csr_matrix, gradient: Array) -> tuple[Array, int]:
        shape, watch = gradient.shape, self.watch
        inverse = (1.0 / np.abs(hessian.diagonal())).reshape(shape)
        with watch.timed("projection"):
            residual = -self._projected(gradient)
            p = z = self._projected(inverse * residual)
        step, rho = np.zeros(shape), float(np.vdot(residual, z))
        target = self.tolerance * float(np.linalg.norm(residual))
        for iteration in range(1, 5001):
            with watch.timed("CG product"):
                product = (hessian @ p.ravel()).reshape(shape)
            curvature = float(np.vdot(p, product))
            if curvature <= 0.0:
                return (p if iteration == 1 else step), iteration
            step = step + rho / curvature * p
            with watch.timed("projection"):
                residual = residual - rho / curvature * self._projected(product)
            if float(np.linalg.norm(residual)) <= target:
                break
            with watch.timed("preconditioner"):
                z = inverse * residual
            with watch.timed("projection"):
                z = self._projected(z)
            rho, previous = float(np.vdot(residual, z)), rho
            p = z + rho / previous * p
        return step, iteration
