"""Contact and friction of the surface of a body in full space, with value, gradient and Hessian contribution.

Both are summed over points of the surface (`runtime/contact/surface_quadrature.py`); their potentials are those of the
runtime. As the others (`potentials.py`), they act on node positions x (n_nodes, dim) in the mesh's order and return
this rank's shares.
"""

from __future__ import annotations

from dataclasses import replace

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
from softprint.runtime.contact.surface_quadrature import SurfaceQuadrature

# A slip has converged if its relative change in a Newton iteration is below this.
_SETTLED = 0.3


class SurfaceContact:
    """Penalty contact of the surface with one collider at one pose, including the curvature of the signed distance.
    points: of the surface, at which contact is evaluated.

    The terms of the last x are cached, because energy, gradient and Hessian are evaluated at the same x.
    """

    def __init__(
        self, contact: PenaltyContact, points: SurfaceQuadrature, collider: Collider, pose: RigidPose
    ) -> None:
        self.contact, self.points = contact, points
        self.collider, self.pose = collider, pose
        self._at: Array | None = None
        self._terms: ContactTerms

    def terms(self, x: Array) -> ContactTerms:
        """Contact terms at x; their index counts the points of the surface."""
        if self._at is not x:
            near = self.points.near(x, self.collider, self.pose)
            own = self.points.positions(x, near), self.points.area(near)
            terms = self.contact.terms(*own, self.collider, self.pose)
            self._terms = replace(terms, index=near[terms.index])
            self._at = x
        return self._terms

    def energy(self, x: Array) -> float:
        return self.terms(x).energy

    def gradient(self, x: Array) -> Array:
        terms = self.terms(x)
        return self.points.gradient(terms.index, terms.gradient, len(x))

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        terms = self.terms(x)
        by_point = positive_part(terms.hessian) if convex else terms.hessian
        matrix.add_facets(*self.points.hessian(terms.index, by_point))

    @property
    def nodes(self) -> IntArray:
        """The nodes that contact may act on."""
        return self.points.nodes

    def accepted(self, x: Array) -> None:
        """Nothing: a penalty does not depend on where a step starts."""

    def touched(self, x: Array) -> IntArray:
        """(k,) nodes that contact acts on, ascending."""
        return np.unique(self.points.corners(self.terms(x).index)[0])

    def max_depth(self, x: Array) -> float:
        """Deepest penetration of a point of the surface [m]; 0 without contact."""
        return float(self.terms(x).depth.max(initial=0.0))


class LaggedFriction:
    """Regularised Coulomb friction over one step; normals and normal forces are lagged: those of the last call of
    `lag`.

    For a point that changes between sticking and slipping, or its direction of slip, Newton's quadratic model is
    poor: with the exact Hessian the line search cuts most steps to a tenth. Such points get the majoriser

        H = mu N f1(y)/y (I - n n^T),   the exact one being   H - mu N (f1(y)/y - f1'(y)) u u^T/y^2

    (iteratively reweighted least squares: never overshoots, converges linearly), and the exact Hessian once
    the slip u has converged: 8 to 15 iterations per step for the jelly, against more than 20 with either alone.

    start: (n_nodes, dim) positions of the nodes at the start of the step [m]; pose_start, pose_end: of the collider.
    """

    def __init__(
        self,
        friction: CoulombFriction,
        points: SurfaceQuadrature,
        start: Array,
        pose_start: RigidPose,
        pose_end: RigidPose,
        time_step: float,
    ) -> None:
        self._friction, self._points, self._start = friction, points, start
        self._pose_start, self._pose_end, self._time_step = pose_start, pose_end, time_step
        self._lagged: LaggedContact

    def lag(self, contact: ContactTerms) -> None:
        """Set the normals and normal forces to those of `contact`, evaluated with the collider at pose_end."""
        self._index = contact.index
        numbered = replace(contact, index=np.arange(len(contact.index)))
        start = self._points.positions(self._start, self._index)
        self._lagged = self._friction.lag(numbered, start, self._pose_start, self._pose_end)
        self._last_slip = np.full_like(self._lagged.anchor, np.inf)

    def _terms(self, x: Array) -> FrictionTerms:
        return self._friction.terms(self._points.positions(x, self._index), self._lagged, self._time_step)

    def energy(self, x: Array) -> float:
        return self._terms(x).energy

    def gradient(self, x: Array) -> Array:
        return self._points.gradient(self._index, self._terms(x).gradient, len(x))

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        terms, slip = self._terms(x), self._slip(x)
        hessian = self._majoriser(terms, slip)
        if not convex:
            change = np.linalg.norm(slip - self._last_slip, axis=1)
            settled = change < _SETTLED * np.linalg.norm(slip, axis=1)
            hessian[settled] = terms.hessian[settled]
            self._last_slip = slip
        matrix.add_facets(*self._points.hessian(self._index, hessian))

    def _slip(self, x: Array) -> Array:
        """u (m, dim): tangential displacement relative to the collider [m]."""
        offset = self._points.positions(x, self._index) - self._lagged.anchor
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
