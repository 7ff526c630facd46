"""Contact and friction of the surface of a body in full space, with value, gradient and Hessian contribution.

Both are summed over points of the surface (`runtime/contact/surface_quadrature.py`), and over its points that a
collider's tips and edges press (`runtime/contact/sharp_planes.py`); their potentials are those of the runtime. As the
others (`potentials.py`), they act on node positions x (n_nodes, dim) in the mesh's order and return this rank's shares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softprint.fem_truth.energy.potentials import Potential
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
from softprint.runtime.contact.sharp_planes import PlaneTerms, SharpPlanes
from softprint.runtime.contact.surface_quadrature import FacetPoints, SurfaceQuadrature

# A slip has converged if its relative change in a Newton iteration is below this.
_SETTLED = 0.3


@dataclass(frozen=True, eq=False)
class BearingPoints:
    """The points of the surface that bear contact forces, n of them. gradient, normal: (n, dim), as in `ContactTerms`;
    depth: (n,) [m]."""

    points: FacetPoints
    gradient: Array
    normal: Array
    depth: Array

    @property
    def index(self) -> IntArray:
        """(n,) of all."""
        return np.arange(len(self.depth))


class SurfaceContact(Potential):
    """Penalty contact of the surface with one collider at one pose, including the curvature of the signed distance.
    points: of the surface, at which contact is evaluated; sharp: the planes of the collider's sharp points during one
    solve, held where the first terms are evaluated.

    The terms of the last x are cached, because energy, gradient and Hessian are evaluated at the same x.
    """

    def __init__(
        self,
        contact: PenaltyContact,
        points: SurfaceQuadrature,
        collider: Collider,
        pose: RigidPose,
        sharp: SharpPlanes | None = None,
    ) -> None:
        self.contact, self.points, self.sharp = contact, points, sharp
        self.collider, self.pose = collider, pose
        self._at: Array | None = None
        self._terms: ContactTerms
        self._sharp_terms: PlaneTerms | None

    def terms(self, x: Array) -> tuple[ContactTerms, PlaneTerms | None]:
        """Contact terms at x; the index of the former counts the points of the surface."""
        if self._at is not x:
            near = self.points.near(x, self.collider, self.pose)
            own = self.points.points(near).positions(x), self.points.area(near)
            terms = self.contact.terms(*own, self.collider, self.pose)
            self._terms = replace(terms, index=near[terms.index])
            self._sharp_terms = None if self.sharp is None else self.sharp.terms(x, self.pose)
            self._at = x
        return self._terms, self._sharp_terms

    def bearing(self, x: Array) -> BearingPoints:
        """Where contact acts."""
        terms, sharp = self.terms(x)
        own = self.points.points(terms.index), terms.gradient, terms.normal, terms.depth
        if sharp is None:
            return BearingPoints(*own)
        others = sharp.gradient, sharp.normal, sharp.depth
        return BearingPoints(
            own[0].joined(sharp.points), *map(np.concatenate, zip(own[1:], others, strict=True))
        )

    def energy(self, x: Array) -> float:
        terms, sharp = self.terms(x)
        return terms.energy + (0.0 if sharp is None else sharp.energy)

    def gradient(self, x: Array) -> Array:
        bearing = self.bearing(x)
        return bearing.points.gradient(bearing.gradient, len(x))

    def blocks(self, x: Array, convex: bool) -> list[tuple[IntArray, Array]]:
        """The second derivatives: nodes (t, c) of facets, and blocks (t, c, c, dim, dim) by pairs of them."""
        terms, sharp = self.terms(x)
        by_point = positive_part(terms.hessian) if convex else terms.hessian
        blocks = [self.points.points(terms.index).hessian(by_point)]
        if sharp is not None and len(sharp.points):
            blocks.append(sharp.points.hessian(sharp.hessian))
        return blocks

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        for nodes, blocks in self.blocks(x, convex):
            matrix.add_facets(nodes, blocks)

    @property
    def nodes(self) -> IntArray:
        """The nodes that contact may act on."""
        return self.points.nodes

    def hold(self, x: Array) -> None:
        """The planes of sharp points are those at x."""
        if self.sharp is not None:
            self.sharp.hold(x, self.pose)
            self._at = None

    def accepted(self, x: Array) -> bool:
        """The planes of sharp points are found again."""
        changed = self.sharp is not None and self.sharp.renew(x, self.pose)
        if changed:
            self._at = None
        return changed

    def touched(self, x: Array) -> IntArray:
        """(k,) nodes that contact acts on, ascending."""
        return np.unique(self.bearing(x).points.nodes)

    def max_depth(self, x: Array) -> float:
        """Deepest penetration of a point of the surface, or of a sharp point of the collider [m]; 0 without contact."""
        return float(self.bearing(x).depth.max(initial=0.0))


class LaggedFriction(Potential):
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
        start: Array,
        pose_start: RigidPose,
        pose_end: RigidPose,
        time_step: float,
    ) -> None:
        self._friction, self._start = friction, start
        self._pose_start, self._pose_end, self._time_step = pose_start, pose_end, time_step
        self._points: FacetPoints
        self._fixed: LaggedContact | None = None
        self._lagged: LaggedContact

    def carry(self, pose: RigidPose) -> None:
        """The collider is at another pose at the end of the step: normals and anchors move with it."""
        self._pose_end = pose
        if self._fixed is not None:
            self._lagged = self._fixed.at(pose)

    def lag(self, bearing: BearingPoints) -> None:
        """Set the points, normals and normal forces to those of a contact with the collider at pose_end."""
        self._points = bearing.points
        start = self._points.positions(self._start)
        self._lagged = self._friction.lag(bearing, start, self._pose_start, self._pose_end)
        self._fixed = self._lagged
        self._last_slip = np.full_like(self._lagged.anchor, np.inf)

    def _terms(self, x: Array) -> FrictionTerms:
        return self._friction.terms(self._points.positions(x), self._lagged, self._time_step)

    def energy(self, x: Array) -> float:
        return self._terms(x).energy

    def gradient(self, x: Array) -> Array:
        return self._points.gradient(self._terms(x).gradient, len(x))

    def blocks(self, x: Array, convex: bool) -> tuple[IntArray, Array]:
        """As `SurfaceContact.blocks`."""
        terms, slip = self._terms(x), self._slip(x)
        hessian = self._majoriser(terms, slip)
        if not convex:
            change = np.linalg.norm(slip - self._last_slip, axis=1)
            settled = change < _SETTLED * np.linalg.norm(slip, axis=1)
            hessian[settled] = terms.hessian[settled]
            self._last_slip = slip
        return self._points.hessian(hessian)

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        matrix.add_facets(*self.blocks(x, convex))

    def _slip(self, x: Array) -> Array:
        """u (m, dim): tangential displacement relative to the collider [m]."""
        offset = self._points.positions(x) - self._lagged.anchor
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
