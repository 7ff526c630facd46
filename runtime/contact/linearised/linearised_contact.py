"""The condensed energy of contact and its derivatives by the handle rows.

The contact points near the colliders are in equilibrium (`contact_solve.py`) at reduced positions x(q), static
condensation included. Let f = p g be the contact forces, D the contact stiffness, G the compliance at rest and
G_w = A G A^T the compliance in the deformed configuration, with the carriers A of `contact_points.py`. With
dxi = dx + dA v the motion of a point whose displacement v is fixed in rest coordinates, and dphi = dA^T f,

    (I + G_w D) dy = dxi + A G dphi =: c,    df = -D dy.

So the energy W(q) of contact and of the displacement that it causes has (Clapeyron's theorem, envelope theorem)

    dW = -sum_j f_j . dxi_j,    d2W = c^T D (I + G_w D)^-1 c - dphi^T G dphi - sum_j f_j . d2A_j v_j.

Both are exact and need no derivative beyond the Hessian of the distance. x and F are affine in the handle rows while
the rotations of the frame of static condensation are fixed. An internal correction of the body is not affine: with it
-sum_j f_j . d2x_j is added. A given displacement c (`given_displacement.py`) is fixed in rest coordinates like v, and
v + c takes the place of v.

The contact Hessian of a reduced step is `LinearisedContact.hessian`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.contact.carriers.point_rotations import (
    PointRotations,
    carried_along,
    pulled_back_along,
)
from softprint.runtime.contact.linearised.contact_motions import ContactMotions
from softprint.runtime.contact.solver.candidates import PointDistance, PosedCollider
from softprint.runtime.contact.solver.contact_points import CorotatedPoints, PointMotion
from softprint.runtime.contact.solver.internal_points import InternalMotion
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.contact.solver.warm_start import WarmStart
from softprint.runtime.contact.solver.woodbury import WoodburyFactor
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.sparse_directions import between_directions

# The step of differences of the Hessian of a distance, as a share of the depth of the contact.
_SMALL = 1e-5


@dataclass(frozen=True, eq=False)
class LinearisedContact:
    """A solved contact in the corotated frame of a step; k points are active, R = n_rows * dim. colliders: those that
    the body touches, in the order of `SolvedContact.names`."""

    start: WarmStart
    points: CorotatedPoints
    colliders: tuple[PosedCollider, ...]

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
        return -self.work(self.force)

    def work(self, forces: Array, moved: Array | None = None) -> Array:
        """sum_j F_j . (dx_j + dA_j v_j) + f_j . dA_j nu_j by the rows (n_rows, dim) [N] of forces F (k, dim) and
        displacements nu (k, dim) [m] in rest coordinates, None for zero. It needs no Jacobian."""
        moments = forces[:, :, None] * self.carried[:, None, :]
        if moved is not None:
            moments += self.force[:, :, None] * moved[:, None, :]
        by_strain = self.carriers.pulled_back(moments)
        found = self.points.handle_forces(self.solved.active, forces, by_strain)
        return found if self._internal is None else found + self._internal.pulled_back(forces)

    def hessian(self, along: Array | None = None) -> Array:
        """d2W/drows2 (R, R) [N/m]; along: see `RowHessian`."""
        motions = self.motions.along(along)
        found = motions.second(motions)
        return np.asarray(found - self.bending(self.force, self.moments, along), dtype=np.float64)

    @lazy
    def motions(self) -> ContactMotions:
        """By the rows: R motions."""
        carried, pulled_back = self.carrier_motion(self.force, self.carried)
        carried += self.derivatives.position.reshape(carried.shape)
        return ContactMotions(self.factor, carried, pulled_back)

    def carrier_motion(self, f: Array, v: Array) -> tuple[Array, Array]:
        """dA v and dA^T f (k*dim, R) of the active points by the rows, of vectors f and v (k, dim)."""
        return carried_along(self.carriers_by_rows, v), pulled_back_along(self.carriers_by_rows, f)

    @lazy
    def carriers_by_rows(self) -> Array:
        """dA (k, dim, dim, R) of the active points by the rows."""
        return self.carriers.by_rows(self.derivatives.basis_gradient)

    @lazy
    def derivatives(self) -> PointMotion:
        """Of the active points by the rows."""
        motion = self.points.motion(self.solved.active)
        if self._internal is None:
            return motion
        return PointMotion(motion.position + self._internal.jacobian, motion.basis_gradient)

    @lazy
    def _internal(self) -> InternalMotion | None:
        """What an internal correction adds to these."""
        return self.points.internal_motion(self.solved.rows, self.solved.active)

    def curvature_change(self, directions: Array) -> Array:
        """t . d3s (k, dim, dim): how the Hessian of the distance at the active points changes along directions t (k,
        dim), by a forward difference. Planes of sharp points have none."""
        solved, b = self.solved, self.solved.solution.active
        found, bent = np.zeros((*directions.shape, directions.shape[1])), np.flatnonzero(~solved.is_pressed)
        lengths, h = np.linalg.norm(directions[bent], axis=1), _SMALL * solved.depth
        if not (len(bent) and h > 0.0):
            return found
        units = directions[bent] / np.where(lengths > 0.0, lengths, 1.0)[:, None]
        distance = PointDistance(solved.names, self.colliders, solved.owner[b[bent]])
        ahead = distance(solved.deformed_position[b[bent]] + h * units).hessian
        found[bent] = (lengths / h)[:, None, None] * (ahead - solved.solution.curvature[b[bent]])
        return found

    @lazy
    def force(self) -> Array:
        """f (k, dim) [N]."""
        return self.solved.solution.force[self.solved.solution.active]

    @lazy
    def carried(self) -> Array:
        """v (k, dim) [m] of the active points with what is given, in rest coordinates: the displacement that A carries
        along."""
        v = self.solved.solution.rest_displacement[self.solved.solution.active]
        return np.asarray(v + self.points.given_displacement(self.solved.active))

    @lazy
    def carriers(self) -> PointRotations:
        """A of the active points, with its derivatives."""
        return self.points.carrier_derivatives(self.solved.rows, self.solved.active)

    @property
    def moments(self) -> Array:
        """f (x) v (k, dim, dim) of the active points, with what is given."""
        return np.asarray(self.force[:, :, None] * self.carried[:, None, :])

    def bending(self, forces: Array, moments: Array, along: Array | None = None) -> Array:
        """sum_j F_j . d2x_j + M_j : d2A_j (R, R) of forces F (k, dim) and moments M (k, dim, dim); along: see
        `RowHessian`."""
        by_rows = self.carriers.bending(moments, self.derivatives.basis_gradient)
        found = by_rows if along is None else between_directions(by_rows, along)
        of_points = None if self._internal is None else self._internal.curvature(forces, along)
        return found if of_points is None else found + of_points
