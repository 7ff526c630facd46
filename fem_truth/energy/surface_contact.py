"""Contact and friction of the surface of a body in full space, with value, gradient and Hessian contribution.

Both are summed over all surface nodes with their lumped areas; their potentials are those of the runtime. As the others
(`potentials.py`), they act on node positions x (n_nodes, dim) in the mesh's order and return this rank's shares.
"""

from __future__ import annotations

import numpy as np

from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.fem_truth.linalg.small_blocks import positive_part
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import (
    ContactTerms,
    CoulombFriction,
    FrictionTerms,
    LaggedContact,
    PenaltyContact,
)

# A slip has converged if its relative change in a Newton iteration is below this.
_SETTLED = 0.3


class SurfaceContact:
    """Penalty contact of the surface nodes with one collider at one pose, including the curvature of the signed
    distance.

    The terms of the last x are cached, because energy, gradient and Hessian are evaluated at the same x.
    """

    def __init__(
        self, contact: PenaltyContact, nodes: IntArray, areas: Array, collider: Collider, pose: RigidPose
    ) -> None:
        self.contact, self.nodes, self.areas = contact, nodes, areas
        self.collider, self.pose = collider, pose
        self._at: Array | None = None
        self._terms: ContactTerms

    def terms(self, x: Array) -> ContactTerms:
        """Contact terms at x; their index counts surface nodes, `nodes[index]` are mesh nodes."""
        if self._at is not x:
            self._terms = self.contact.terms(x[self.nodes], self.areas, self.collider, self.pose)
            self._at = x
        return self._terms

    def energy(self, x: Array) -> float:
        return self.terms(x).energy

    def gradient(self, x: Array) -> Array:
        terms, gradient = self.terms(x), np.zeros_like(x)
        gradient[self.nodes[terms.index]] = terms.gradient
        return gradient

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        terms = self.terms(x)
        matrix.add_diagonal(
            self.nodes[terms.index], positive_part(terms.hessian) if convex else terms.hessian
        )

    def max_depth(self, x: Array) -> float:
        """Deepest penetration of a surface node [m]; 0 without contact."""
        return float(self.terms(x).depth.max(initial=0.0))


class LaggedFriction:
    """Regularised Coulomb friction over one step; normals and normal forces are lagged: those of the last call of
    `lag`.

    For a point that changes between sticking and slipping, or its direction of slip, Newton's quadratic model is
    poor: with the exact Hessian the line search cuts most steps to a tenth. Such points get the majoriser

        H = mu N f1(y)/y (I - n n^T),   the exact one being   H - mu N (f1(y)/y - f1'(y)) u u^T/y^2

    (iteratively reweighted least squares: never overshoots, converges linearly), and the exact Hessian once
    the slip u has converged: 8 to 15 iterations per step for the jelly, against more than 20 with either alone.

    start: (n_surface, dim) positions of the surface nodes at the start of the step [m]; pose_start, pose_end: of the
    collider.
    """

    def __init__(
        self,
        friction: CoulombFriction,
        nodes: IntArray,
        start: Array,
        pose_start: RigidPose,
        pose_end: RigidPose,
        time_step: float,
    ) -> None:
        self._friction, self._nodes, self._start = friction, nodes, start
        self._pose_start, self._pose_end, self._time_step = pose_start, pose_end, time_step
        self._lagged: LaggedContact

    def lag(self, contact: ContactTerms) -> None:
        """Set the normals and normal forces to those of `contact`, evaluated with the collider at pose_end."""
        self._lagged = self._friction.lag(contact, self._start, self._pose_start, self._pose_end)
        self._last_slip = np.full_like(self._lagged.anchor, np.inf)

    def _terms(self, x: Array) -> FrictionTerms:
        return self._friction.terms(x[self._nodes], self._lagged, self._time_step)

    def energy(self, x: Array) -> float:
        return self._terms(x).energy

    def gradient(self, x: Array) -> Array:
        terms, gradient = self._terms(x), np.zeros_like(x)
        gradient[self._nodes[terms.index]] = terms.gradient
        return gradient

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        terms, slip = self._terms(x), self._slip(x)
        hessian = self._majoriser(terms, slip)
        if not convex:
            change = np.linalg.norm(slip - self._last_slip, axis=1)
            settled = change < _SETTLED * np.linalg.norm(slip, axis=1)
            hessian[settled] = terms.hessian[settled]
            self._last_slip = slip
        matrix.add_diagonal(self._nodes[terms.index], hessian)

    def _slip(self, x: Array) -> Array:
        """u (m, dim): tangential displacement relative to the collider [m]."""
        offset = x[self._nodes[self._lagged.index]] - self._lagged.anchor
        normal = self._lagged.normal
        return offset - (offset * normal).sum(axis=1, keepdims=True) * normal

    def _majoriser(self, terms: FrictionTerms, slip: Array) -> Array:
        """|gradient| / |u| (I - n n^T); at u = 0 its limit, f1(y)/y -> 2/eps."""
        normal, friction = self._lagged.normal, self._friction
        length = np.linalg.norm(slip, axis=1)
        limit = 2.0 * friction.coefficient * self._lagged.force / (friction.slip_velocity * self._time_step)
        moving = length > 1e-9 * friction.slip_velocity * self._time_step
        ratio = np.linalg.norm(terms.gradient, axis=1) / np.where(moving, length, 1.0)
        stiffness = np.where(moving, ratio, limit)
        tangent = np.eye(slip.shape[1]) - normal[:, :, None] * normal[:, None, :]
        return stiffness[:, None, None] * tangent
