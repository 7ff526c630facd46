"""The condensed energy of contact and its derivatives by the handle rows.

The contact points near the colliders are in equilibrium (`contact_solve.py`) at reduced positions x(q), static
condensation included. Let f = p g be the contact forces, D the contact stiffness, G the compliance at rest and
G_w = A G A^T the compliance in the deformed configuration, with the carriers A of `contact_points.py`. With
dxi = dx + dA v the motion of a point whose displacement v is fixed in rest coordinates, and dphi = dA^T f,

    (I + G_w D) dy = dxi + A G dphi =: c,    df = -D dy.

So the energy W(q) of contact and of the displacement that it causes has (Clapeyron's theorem, envelope theorem)

    dW = -sum_j f_j . dxi_j,    d2W = c^T D (I + G_w D)^-1 c - dphi^T G dphi - sum_j f_j . d2A_j v_j.

Both are exact and need no derivative beyond the Hessian of the distance. x and F are affine in the handle rows while
the rotations of the frame are fixed; so the last term is zero where A = F, and for a scale of the compliance, A = s F,

    f . d2A v = f . A v (dtheta dtheta^T + d2theta) + s f . (dF dtheta + dtheta dF) v.

The contact Hessian of a reduced step is `LinearisedContact.hessian`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.solver import contact_point_kernels as kernels
from softprint.runtime.contact.solver.compliance_scale import ScaleDerivatives
from softprint.runtime.contact.solver.contact_points import CorotatedPoints, PointMotion
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.contact.solver.warm_start import WarmStart
from softprint.runtime.contact.solver.woodbury import WoodburyFactor
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.sparse_directions import between_directions, times_directions


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

    @lazy
    def gradient(self) -> Array:
        """dW/drows (n_rows, dim) [N]."""
        solved, b = self.solved, self.solved.solution.active
        f, v, scales = solved.solution.force[b], solved.solution.rest_displacement[b], self._scales
        if scales is None:
            return -self.points.handle_forces(solved.active, f, v)
        work = (f * solved.solution.displacement[b]).sum(axis=1)
        by_strain = work[:, None, None] * scales.slope
        return -self.points.handle_forces(solved.active, f, scales.scale[:, None] * v, by_strain)

    def hessian(self, along: Array | None = None) -> Array:
        """d2W/drows2 (R, R) [N/m]; along: see `RowHessian`."""
        kind = self.start.compliance.dtype
        by_position, by_force = (jacobian.astype(kind, copy=False) for jacobian in self._jacobians)
        if along is not None:
            by_position, by_force = times_directions(by_position, along), times_directions(by_force, along)
        by_displacement = self.factor.rest_displacement(by_force)
        c = by_position + self.factor.to_world(by_displacement)
        found = self.factor.stiffness_form(c) - by_force.T @ by_displacement
        if self._scales is not None:
            bending = self._bending if along is None else between_directions(self._bending, along)
            found = found - bending
        return np.asarray(found, dtype=np.float64)

    @property
    def position_jacobian(self) -> Array:
        """dx + dA v (k*dim, R) of the active points: their motion with the displacement v fixed in rest coordinates."""
        return self._jacobians[0]

    @property
    def force_jacobian(self) -> Array:
        """dphi = dA^T f (k*dim, R) of the active points: the change of their rest forces with the contact forces
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
        motion, scales = self.motion, self._scales
        v, f = solution.rest_displacement[b], solution.force[b]
        if scales is None:
            return kernels.contact_jacobians(v, f, motion.position, motion.basis_gradient)
        s = scales.scale[:, None]
        by_position, by_force = kernels.contact_jacobians(
            s * v, s * f, motion.position, motion.basis_gradient
        )
        by_theta = scales.by_rows(motion.basis_gradient)[:, None]
        by_position += (solution.displacement[b][..., None] * by_theta).reshape(by_position.shape)
        by_force += (self.solved.rest_force[..., None] * by_theta).reshape(by_force.shape)
        return by_position, by_force

    @lazy
    def motion(self) -> PointMotion:
        """The motion of the active points by the rows."""
        return self.points.motion(self.solved.active)

    @lazy
    def _scales(self) -> ScaleDerivatives | None:
        """Of the active points."""
        return self.points.scale_derivatives(self.solved.rows, self.solved.active)

    @lazy
    def _bending(self) -> Array:
        """sum_j f_j . d2A_j v_j (R, R) of a compliance that is scaled."""
        scales, solution = self._scales, self.solved.solution
        assert scales is not None
        b, gradient, slope = solution.active, self.motion.basis_gradient, scales.slope
        v, f = solution.rest_displacement[b], solution.force[b]
        work = (f * solution.displacement[b]).sum(axis=1)[:, None, None, None, None]
        stretched = (scales.scale[:, None] * f)[:, :, None] * v[:, None, :]
        crossed = slope[:, :, :, None, None] * stretched[:, None, None]
        by_F = work * (slope[:, :, :, None, None] * slope[:, None, None] + scales.curvature)
        by_F += crossed + crossed.transpose(0, 3, 4, 1, 2)
        k, n_rows, dim = gradient.shape
        half = np.matmul(gradient, by_F.transpose(0, 2, 1, 3, 4).reshape(k, dim, dim**3))
        left = (
            half.reshape(k, n_rows * dim * dim, dim).transpose(1, 0, 2).reshape(n_rows * dim * dim, k * dim)
        )
        whole = left @ gradient.transpose(0, 2, 1).reshape(k * dim, n_rows)
        return (
            whole.reshape(n_rows, dim, dim, n_rows).transpose(0, 1, 3, 2).reshape(n_rows * dim, n_rows * dim)
        )
