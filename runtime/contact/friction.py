"""Coulomb friction as a lagged, smoothed dissipative potential (IPC: Li et al. 2020).

Over one step of length h a contact point moves by u_i relative to the collider; with P_i = I - n_i n_i^T,
the normal force N_i and the normal n_i fixed at their values of the last evaluation of contact (lagged),

    D(x) = sum_i mu N_i f0(|P_i u_i|),    u_i = x_i - T_end T_start^-1 x_i,start,

    f0(y) = y^2/eps - y^3/(3 eps^2) + eps/3   for y < eps,   else y          (C2)
    f1(y) = f0'(y) = 2 y/eps - y^2/eps^2      for y < eps,   else 1          (C1; IPC eq. 14)

where eps = slip_velocity h. Points slower than slip_velocity stick, up to that creep; on faster points the friction
force is mu N. The Hessian is positive semi-definite. u_i is relative to the motion of the collider over the step, so
friction vanishes on a body that moves rigidly with the collider.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import point_kernels as kernels
from softprint.runtime.errors import SoftprintError


class NormalContact(Protocol):
    """What friction needs of contact terms (`ContactTerms`)."""

    @property
    def index(self) -> IntArray: ...
    @property
    def gradient(self) -> Array: ...
    @property
    def normal(self) -> Array: ...


@dataclass(frozen=True, eq=False)
class LaggedContact:
    """The lagged quantities that friction keeps fixed within a minimisation, for the m points in contact; world
    coordinates.

    index (m,) of the points; force (m,) normal force [N]; normal (m, dim); anchor (m, dim) [m]: the position of the
    point at the end of the step if it stuck to the collider, with the collider at `pose`.
    """

    index: IntArray
    force: Array
    normal: Array
    anchor: Array
    pose: RigidPose

    def at(self, pose: RigidPose) -> LaggedContact:
        """The same with the collider at another pose: normals and anchors move rigidly with the collider, so that
        friction is invariant to a common rigid motion of points and collider."""
        if pose is self.pose or not len(self.index):
            return self
        change = pose.compose(self.pose.inverse())
        return replace(self, normal=change.rotate(self.normal), anchor=change.apply(self.anchor), pose=pose)


@dataclass(frozen=True, eq=False)
class FrictionTerms:
    """energy [J]; index (m,) of the points; gradient (m, dim) [N], the friction force being its negative;
    hessian (m, dim, dim) [N/m]; world coordinates."""

    energy: float
    index: IntArray
    gradient: Array
    hessian: Array


@dataclass(frozen=True)
class CoulombFriction:
    """coefficient mu [1] and slip_velocity [m/s], below which contact counts as sticking."""

    coefficient: float
    slip_velocity: float = 1e-3

    def __post_init__(self) -> None:
        if not (np.isfinite(self.coefficient) and self.coefficient >= 0):
            raise SoftprintError(f"the friction coefficient must be zero or positive, not {self.coefficient}")
        if not (np.isfinite(self.slip_velocity) and self.slip_velocity > 0):
            raise SoftprintError(
                f"the slip velocity must be a positive number of m/s, not {self.slip_velocity}"
            )

    def lag(
        self, contact: NormalContact, start: Array, pose_start: RigidPose, pose_end: RigidPose
    ) -> LaggedContact:
        """Fix the normals and normal forces of `contact`, evaluated with the collider at pose_end.

        start: (n, dim) world positions, at the start of the step, of the points that `contact` was evaluated at;
        pose_start, pose_end: the collider's pose at the start and at the end of the step.
        """
        return LaggedContact(
            index=contact.index,
            force=np.linalg.norm(contact.gradient, axis=1),
            normal=contact.normal,
            anchor=pose_end.apply(pose_start.apply_inverse(start[contact.index])),
            pose=pose_end,
        )

    def terms(self, x: Array, lagged: LaggedContact, time_step: float) -> FrictionTerms:
        """Energy, gradient and Hessian at world points x (n, dim) [m] for a step of time_step [s]."""
        if not len(lagged.index):
            dim = x.shape[1]
            return FrictionTerms(0.0, lagged.index, np.empty((0, dim)), np.empty((0, dim, dim)))
        eps = self.slip_velocity * time_step
        weight = self.coefficient * lagged.force
        found = kernels.friction(x[lagged.index], lagged.anchor, lagged.normal, weight, eps)
        energy, gradient, hessian = found
        return FrictionTerms(energy, lagged.index, gradient, hessian)
