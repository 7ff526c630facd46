"""Full-space equilibria with a given reduced state (thesis 5.3.3): the ground truth of contact
displacements.

    x = argmin W_elastic(x) + W_gravity(x) + W_contact(x)   subject to   C^T (x - U q) = 0,

with C the columns of U that belong to point handles (`ReducedBody.constraint_basis`), and the nodes of rigid frames
fixed at (U q)_i. The unknowns are in the null space of C^T on the free nodes.

When a body is partitioned over several ranks, all ranks call the same methods with the same arguments and get the same
results: positions of all nodes, in the body's order. Internally, positions are those of the nodes on this rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.elasticity.linear_response import QuadraticElasticity
from softprint.fem_truth.energy.potentials import Gravity, Potential
from softprint.fem_truth.energy.surface_contact import SurfaceContact
from softprint.fem_truth.energy.total_energy import Elastic, ElasticTangent, Gradient, TotalEnergy
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.parts.body_part import whole_body
from softprint.fem_truth.statics.newton import FullSpaceSettings, NewtonResult, minimise
from softprint.fem_truth.statics.stability import smallest_ritz_value
from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.sharp_planes import SharpSurface, undented_normals
from softprint.runtime.optimise import NewtonSettings, Status

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody


@dataclass(frozen=True, eq=False)
class Solution:
    """A full-space equilibrium and its quality.

    x: (n_nodes, dim) [m]; residual, decrement: relative, see `fem_truth.statics.newton`; min_det_F: smallest volume
    ratio of a cell; max_depth: deepest penetration [m]; energy: total [J]; handle_force: (n_rows, dim) [N] the
    derivative of the energy of equilibria by the handle rows (the Lagrange multipliers of the constraint, on the rows);
    stable: no negative curvature was seen; min_eigenvalue: lowest Ritz value relative to the block diagonal
    (`fem_truth.statics.stability`; internal equilibria only, NaN otherwise); seconds: processor time, summed over all
    ranks; `reason` says in a sentence how the solve ended.
    """

    x: Array
    status: Status
    residual: float
    decrement: float
    newton_iterations: int
    cg_iterations: int
    min_det_F: float
    max_depth: float
    energy: float
    handle_force: Array
    seconds: float
    stable: bool
    min_eigenvalue: float

    @property
    def converged(self) -> bool:
        return self.status is Status.CONVERGED

    @property
    def reason(self) -> str:
        return self.status.sentence


#: A contact sample: an error of about 1 % in the energy norm before the last Newton step, much less after it.
CONTACT_SETTINGS = FullSpaceSettings()

#: Contact displacement is measured from the internal equilibrium, which is therefore solved to six more
#: digits.
INTERNAL_SETTINGS = FullSpaceSettings(
    NewtonSettings(max_iterations=60, tolerance=1e-7), decrement_tolerance=1e-12, cg_tolerance_min=1e-4
)

# Lower bound of the contact force scale, as a share of the elastic forces. Without it, a body that is hardly touched
# would have to be solved to round-off.
_FORCE_FLOOR = 1e-3


# Largest extrapolation along a sequence of contact solves, as a multiple of the last step.
_FARTHEST = 2.0


class InternalEnergy(TotalEnergy):
    """Elasticity and gravity. Force scale: the unprojected elastic forces; energy scale: W."""

    def __init__(
        self, elasticity: FullSpaceElasticity, terms: Sequence[Potential], null_space: NullSpace
    ) -> None:
        super().__init__(elasticity, terms, null_space)
        self._force_floor = 1e-9 * elasticity.unit_force
        self._energy_floor = 1e-12 * elasticity.unit_energy

    def force_scale(self, x: Array, gradient: Gradient) -> float:
        share = self.null_space.share
        return max(share.norm(share.assembled(gradient.elastic)), self._force_floor)

    def energy_scale(self, x: Array) -> float:
        return max(self.null_space.share.total(self.elastic.energy(x)), self._energy_floor)


class ContactEnergy(TotalEnergy):
    """Elasticity, gravity and contact. Force scale: the projected contact force; energy scale: the work of the
    contact force over the displacement it caused, f . (x - reference) ~ u^T K u."""

    def __init__(
        self,
        elastic: Elastic,
        terms: Sequence[Potential],
        contact: SurfaceContact,
        null_space: NullSpace,
        tangent: ElasticTangent,
        reference: Array,
        floors: tuple[float, float],
    ) -> None:
        super().__init__(elastic, (*terms, contact), null_space, tangent)
        self._contact, self._reference = contact, reference
        self._force_floor, self._energy_floor = floors

    def force_scale(self, x: Array, gradient: Gradient) -> float:
        share = self.null_space.share
        by_contact = share.assembled(self._contact.gradient(x))
        nodes = np.flatnonzero(by_contact[share.owned].any(axis=1))
        return max(self.null_space.projected_norm(nodes, by_contact[nodes]), self._force_floor)

    def energy_scale(self, x: Array) -> float:
        work = np.vdot(self._contact.gradient(x), x - self._reference)
        work, energy = self.null_space.share.total(np.array([work, self._contact.energy(x)]))
        return max(abs(float(work)), float(energy), self._energy_floor)


class ConstrainedProblem:
    """Equilibria of one body with a given reduced state. gravity: (dim,) [m/s^2] or None."""

    def __init__(
        self,
        elasticity: FullSpaceElasticity,
        gravity: Array | None,
        contact: PenaltyContact,
        body: ReducedBody,
    ) -> None:
        self.elasticity, self.contact, self.body = elasticity, contact, body
        self.part = part = elasticity.part or whole_body(body)
        self.contact_points = part.contact_points(contact.refinement)
        self._sharp: dict[Collider, SharpSurface | None] = {}
        self._normals = np.empty(0), np.empty(0)
        self.null_space = NullSpace(part.constraint_basis, part.frame_nodes, part.share)
        self.terms: tuple[Potential, ...] = ()
        if gravity is not None and np.any(gravity):
            self.terms = (Gravity(part.node_mass, np.asarray(gravity, dtype=float), part.mesh.points),)

    def surface_contact(self, rows: Array, collider: Collider, pose: RigidPose) -> SurfaceContact:
        """Contact with the collider at a pose, for one solve at handle rows."""
        if collider not in self._sharp:
            self._sharp[collider] = SharpSurface.of(collider, self.contact, self.body.mesh)
        sharp = self._sharp[collider]
        planes = None if sharp is None else self.part.sharp_planes(sharp, self._normals_at(rows))
        return SurfaceContact(self.contact, self.contact_points, collider, pose, planes)

    def _normals_at(self, rows: Array) -> Array:
        """Of the surface without dents, see `undented_normals`; those of the last state are kept."""
        if not np.array_equal(rows, self._normals[0]):
            self._normals = rows.copy(), undented_normals(self.body, rows)
        return self._normals[1]

    def constrained(self, rows: Array, x: Array) -> Array:
        """The positions nearest to x (n_nodes, dim) that satisfy the constraint of the state."""
        return self.part.whole(self.constrained_part(rows, x))

    def constrained_part(self, rows: Array, x: Array) -> Array:
        """As `constrained`, for the nodes on this rank only."""
        reduced = self.part.reduced_positions(rows)
        return reduced + self.null_space.project(self.part.take(x) - reduced)

    def violation(self, rows: Array, x: Array) -> float:
        """Constraint violation of x [m]: the largest component in an orthonormal basis of C."""
        return self.null_space.violation(self.part.take(x - self.body.reduced_positions(rows)))

    def internal_equilibrium(
        self, rows: Array, settings: FullSpaceSettings = INTERNAL_SETTINGS, x0: Array | None = None
    ) -> Solution:
        """The equilibrium without contact, started from x0 or the reduced positions. A saddle point gets the status
        UNSTABLE."""
        start = self.constrained_part(rows, self.body.reduced_positions(rows) if x0 is None else x0)
        result = minimise(InternalEnergy(self.elasticity, self.terms, self.null_space), start, settings)
        lowest = np.nan
        if result.converged:
            lowest = smallest_ritz_value(self.elasticity.hessian(result.x), self.null_space)
        status = Status.UNSTABLE if lowest <= 0 else result.status
        return _solution(self, result, status, 0.0, lowest)

    def press(self, rows: Array, collider: Collider, internal: Array) -> Press:
        """A contact to be solved from shallow to deep; internal: the state's internal equilibrium."""
        return Press(self, self.elasticity, ElasticTangent(self.elasticity), rows, collider, internal)

    def solve(
        self,
        rows: Array,
        collider: Collider,
        pose: RigidPose,
        x0: Array,
        settings: FullSpaceSettings = CONTACT_SETTINGS,
        internal: Array | None = None,
    ) -> Solution:
        """A single equilibrium with the collider at `pose`, started from x0: the internal equilibrium, or the
        solution at a smaller depth.

        internal: the internal equilibrium (n_nodes, dim), from which the scale of the decrement is measured;
        by default x0, which is stricter. `press` is faster for a sequence of depths.
        """
        press = self.press(rows, collider, x0 if internal is None else internal)
        return press.solve(pose, settings, x0)

    def linear_response(
        self,
        rows: Array,
        collider: Collider,
        pose: RigidPose,
        x_internal: Array,
        settings: FullSpaceSettings = CONTACT_SETTINGS,
        x0: Array | None = None,
    ) -> Solution:
        """Baseline: elasticity linearised about x_internal, with the full contact model."""
        return self.linear_press(rows, collider, x_internal).solve(pose, settings, x0)

    def linear_press(self, rows: Array, collider: Collider, internal: Array) -> Press:
        """Same as `press`, with elasticity linearised about the internal equilibrium."""
        linear = QuadraticElasticity(self.elasticity, self.part.take(internal))
        return Press(self, linear, ElasticTangent(linear), rows, collider, internal)


class Press:
    """The contact solves of one collider at one state, for a sequence of poses; each solve starts from those before it.

    Results depend only on the arguments and the poses solved so far, so a press is the unit of work that is
    distributed over ranks.
    """

    def __init__(
        self,
        problem: ConstrainedProblem,
        elastic: Elastic,
        tangent: ElasticTangent,
        rows: Array,
        collider: Collider,
        internal: Array,
    ) -> None:
        self._problem, self._elastic, self._tangent = problem, elastic, tangent
        self._rows, self._collider = rows, collider
        self._internal = problem.constrained_part(rows, internal)
        #: Depths and positions of the last two solves: the next one starts on their secant.
        self._path = [(0.0, self._internal)]
        elasticity, share = problem.elasticity, problem.part.share
        energy, gradient = elastic.energy_gradient(self._internal)
        self._floors = (
            max(_FORCE_FLOOR * share.norm(share.assembled(gradient)), 1e-9 * elasticity.unit_force),
            max(_FORCE_FLOOR**2 * abs(share.total(energy)), 1e-12 * elasticity.unit_energy),
        )

    def solve(
        self, pose: RigidPose, settings: FullSpaceSettings = CONTACT_SETTINGS, x0: Array | None = None
    ) -> Solution:
        """The equilibrium with the collider at `pose`; started from x0 (n_nodes, dim), or by default on the secant
        through the last two converged solutions."""
        problem = self._problem
        contact = problem.surface_contact(self._rows, self._collider, pose)
        depth = self._depth(pose)
        start = self._extrapolated(depth) if x0 is None else problem.constrained_part(self._rows, x0)
        energy = ContactEnergy(
            self._elastic,
            problem.terms,
            contact,
            problem.null_space,
            self._tangent,
            self._internal,
            self._floors,
        )
        result = minimise(energy, start, settings)
        if result.converged:
            self._path = [*self._path[-1:], (depth, result.x)]
        return _solution(problem, result, result.status, contact.max_depth(result.x), np.nan)

    def _depth(self, pose: RigidPose) -> float:
        """Penetration depth of the collider at the internal equilibrium [m]."""
        part = self._problem.part
        local = pose.apply_inverse(self._internal[part.surface_nodes])
        _, inside = self._collider.closer(local, 0.0)
        distance = inside if len(inside) else self._collider.sdf(local)
        return -part.share.smallest(float(distance.min(initial=np.inf)))

    def _extrapolated(self, depth: float) -> Array:
        """Linear extrapolation of the last two solutions. Without it, the collider would move past the nodes that it
        pushes."""
        last_depth, last = self._path[-1]
        if len(self._path) == 1:
            return last
        before_depth, before = self._path[0]
        if last_depth == before_depth:
            return last
        share = (depth - last_depth) / (last_depth - before_depth)
        return last + float(np.clip(share, -_FARTHEST, _FARTHEST)) * (last - before)


def _solution(
    problem: ConstrainedProblem,
    result: NewtonResult[Array],
    status: Status,
    max_depth: float,
    min_eigenvalue: float,
) -> Solution:
    part, share = problem.part, problem.part.share
    return Solution(
        x=part.whole(result.x),
        status=status,
        residual=result.residual,
        decrement=result.decrement,
        newton_iterations=result.newton_iterations,
        cg_iterations=result.cg_iterations,
        min_det_F=share.smallest(problem.elasticity.min_det_F(result.x)),
        max_depth=share.largest(max_depth),
        energy=result.energy,
        handle_force=part.handle_force(result.gradient),
        seconds=share.total(result.seconds),
        stable=status is not Status.UNSTABLE and result.negative_curvature is None,
        min_eigenvalue=min_eigenvalue,
    )
