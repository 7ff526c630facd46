"""The condensed energy of contact and its derivatives by the handle rows.

The contact points near the colliders are in equilibrium (`contact_solve.py`) at reduced positions x(q), static
condensation included. Let f = p g be the contact forces, D the contact stiffness, G the compliance at rest and
G_w = F G F^T the compliance in the deformed configuration. With dxi = dx + dF v the motion of a point whose
displacement v is fixed in rest coordinates, and dphi = dF^T f,

    (I + G_w D) dy = dxi + F G dphi =: c,    df = -D dy.

So the energy W(q) of contact and of the displacement that it causes has (Clapeyron's theorem, envelope theorem)

    dW = -sum_j f_j . dxi_j,    d2W = c^T D (I + G_w D)^-1 c - dphi^T G dphi,

Both are exact and need no derivative beyond the Hessian of the distance, because x and F are affine in the handle rows
while the rotations of the frame are fixed. The contact Hessian of a reduced step is `LinearisedContact.hessian`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.solver import contact_point_kernels as kernels
from softprint.runtime.contact.solver.contact_points import CorotatedPoints
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.contact.solver.warm_start import WarmStart
from softprint.runtime.contact.solver.woodbury import WoodburyFactor
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.sparse_directions import times_directions


@dataclass(frozen=True, eq=False)
class LinearisedContact:
    """A solved contact in the corotated frame of a step; k points are active, R = n_rows * dim."""

    start: WarmStart
    points: CorotatedPoints

    @property
    def solved(self) -> SolvedContact:
        """The solved contact that is linearised."""
        return self.start.solved

    @property
    def factor(self) -> WoodburyFactor:
        """The Woodbury factorisation of the active points."""
        return self.start.factor

    @property
    def gradient(self) -> Array:
        """dW/drows (n_rows, dim) [N]."""
        solved, b = self.solved, self.solved.solution.active
        v = solved.solution.rest_displacement[b]
        return -self.points.handle_forces(solved.active, solved.solution.force[b], v)

    def hessian(self, along: Array | None = None) -> Array:
        """d2W/drows2 (R, R) [N/m]; along: see `RowHessian`."""
        kind = self.start.compliance.dtype
        by_position, by_force = (jacobian.astype(kind, copy=False) for jacobian in self._jacobians)
        if along is not None:
            by_position, by_force = times_directions(by_position, along), times_directions(by_force, along)
        by_displacement = self.factor.rest_displacement(by_force)
        c = by_position + self.factor.to_world(by_displacement)
        return np.asarray(self.factor.stiffness_form(c) - by_force.T @ by_displacement, dtype=np.float64)

    @property
    def position_jacobian(self) -> Array:
        """dx + dF v (k*dim, R) of the active points: their motion with the displacement v fixed in rest coordinates."""
        return self._jacobians[0]

    @property
    def force_jacobian(self) -> Array:
        """dphi = dF^T f (k*dim, R) of the active points: the change of their rest forces with the contact forces
        fixed."""
        return self._jacobians[1]

    @lazy
    def displacement_jacobian(self) -> Array:
        """G dphi (k*dim, R)."""
        return self.factor.rest_displacement(self.force_jacobian)

    @lazy
    def force_response(self) -> Array:
        """D (I + G_w D)^-1 c (k*dim, R)."""
        c = self.position_jacobian + self.factor.to_world(self.displacement_jacobian)
        return self.factor.effective_stiffness(c)

    @lazy
    def _jacobians(self) -> tuple[Array, Array]:
        solution = self.solved.solution
        b = solution.active
        motion = self.points.motion(self.solved.active)
        return kernels.contact_jacobians(
            solution.rest_displacement[b], solution.force[b], motion.position, motion.basis_gradient
        )
