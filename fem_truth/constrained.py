"""Full-space equilibria that have a given reduced state (thesis 5.3.3): the ground truth of contact displacements.

    x = argmin W_elastic(x) + W_gravity(x) + W_contact(x)   subject to   U^T (x - U q) = 0,

the nodes of rigid frames sitting at (U q)_i. The unknowns live in the null space of U on the free nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fem_truth.full_space_elasticity import FullSpaceElasticity
from fem_truth.linear_response import QuadraticElasticity
from fem_truth.newton import NewtonResult, NewtonSettings, Status, minimise
from fem_truth.null_space import NullSpace
from fem_truth.potentials import Elastic, Gravity, Potential, SurfaceContact, TotalEnergy
from fem_truth.stability import smallest_ritz_value
from runtime.arrays import Array
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.contact import PenaltyContact

if TYPE_CHECKING:
    from runtime.body import ReducedBody


@dataclass(frozen=True, eq=False)
class Solution:
    """A full-space equilibrium and how well it is known.

    x: (n_nodes, dim) [m]; residual, decrement: relative, see `fem_truth.newton`; min_det_F: smallest volume ratio of a
    cell; max_depth: deepest penetration [m]; energy: total [J]; stable: no negative curvature was seen;
    min_eigenvalue: lowest Ritz value relative to the block diagonal (`fem_truth.stability`; internal equilibria only,
    NaN otherwise); `reason` says in a sentence how the solve ended.
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
    seconds: float
    stable: bool
    min_eigenvalue: float

    @property
    def converged(self) -> bool:
        return self.status is Status.CONVERGED

    @property
    def reason(self) -> str:
        return self.status.sentence


#: An internal equilibrium is the zero from which contact displacement is measured: it is worth six more digits.
INTERNAL_SETTINGS = NewtonSettings(gradient_tolerance=1e-7, decrement_tolerance=1e-12, cg_tolerance_min=1e-4)

# Contact forces below this share of the elastic forces are not resolved relative to themselves, but to this floor:
# without one, a body that is hardly touched would have to be solved to round-off.
_FORCE_FLOOR = 1e-3


class InternalEnergy(TotalEnergy):
    """Elasticity and gravity; forces are measured against the elastic forces, unprojected, energies against W."""

    def __init__(self, elasticity: FullSpaceElasticity, terms: Sequence[Potential]) -> None:
        super().__init__(elasticity, terms)
        self._force_floor = 1e-9 * elasticity.force_scale
        self._energy_floor = 1e-12 * elasticity.energy_scale

    def force_scale(self, x: Array) -> float:
        return max(float(np.linalg.norm(self.elastic.gradient(x))), self._force_floor)

    def energy_scale(self, x: Array) -> float:
        return max(self.elastic.energy(x), self._energy_floor)


class ContactEnergy(TotalEnergy):
    """Elasticity, gravity and contact. Forces are measured against the contact force, projected; energies against the
    work of the contact force over the displacement it caused, f . (x - internal) ~ u^T K u."""

    def __init__(
        self,
        elastic: Elastic,
        terms: Sequence[Potential],
        contact: SurfaceContact,
        null_space: NullSpace,
        internal: Array,
        floors: tuple[float, float],
    ) -> None:
        super().__init__(elastic, (*terms, contact))
        self._contact, self._null_space, self._internal = contact, null_space, internal
        self._force_floor, self._energy_floor = floors

    def force_scale(self, x: Array) -> float:
        force = self._null_space.project(self._contact.gradient(x))
        return max(float(np.linalg.norm(force)), self._force_floor)

    def energy_scale(self, x: Array) -> float:
        terms = self._contact.terms(x)
        moved = (x - self._internal)[self._contact.nodes[terms.index]]
        return max(abs(float(np.vdot(terms.gradient, moved))), terms.energy, self._energy_floor)


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
        mesh = body.mesh
        self.null_space = NullSpace(body.basis, body.handles.frame_nodes)
        self._surface_nodes, self._surface_areas = mesh.surface_nodes, mesh.surface_areas
        self._terms: tuple[Potential, ...] = ()
        if gravity is not None and np.any(gravity):
            self._terms = (Gravity(body.node_mass, np.asarray(gravity, dtype=float), mesh.points),)

    def constrained(self, rows: Array, x: Array) -> Array:
        """The positions nearest to x (n_nodes, dim) that satisfy the constraint of the state `rows` exactly."""
        reduced = self.body.reduced_positions(rows)
        return reduced + self.null_space.project(x - reduced)

    def violation(self, rows: Array, x: Array) -> float:
        """How far x is from the constraint [m]: the largest component in an orthonormal basis of U."""
        return self.null_space.violation(x - self.body.reduced_positions(rows))

    def internal_equilibrium(
        self, rows: Array, settings: NewtonSettings = INTERNAL_SETTINGS, x0: Array | None = None
    ) -> Solution:
        """The equilibrium without contact, from x0 or the reduced positions. A saddle gets the status UNSTABLE."""
        start = self.constrained(rows, self.body.reduced_positions(rows) if x0 is None else x0)
        energy = InternalEnergy(self.elasticity, self._terms)
        result = minimise(energy, self.null_space, start, settings)
        lowest = smallest_ritz_value(energy.hessian(result.x), self.null_space) if result.converged else np.nan
        status = Status.UNSTABLE if lowest <= 0 else result.status
        return self._solution(result, status, 0.0, lowest)

    def solve(
        self,
        rows: Array,
        collider: Collider,
        pose: RigidPose,
        x0: Array,
        settings: NewtonSettings = NewtonSettings(),
        internal: Array | None = None,
    ) -> Solution:
        """The equilibrium with the collider at `pose`, from x0: the internal equilibrium, or the last shallower depth.

        internal: the internal equilibrium (n_nodes, dim), from which the scale of the decrement is measured; x0 if it
        is not given, which is stricter.
        """
        return self._solve_contact(self.elasticity, rows, collider, pose, x0, settings, internal)

    def linear_response(
        self,
        rows: Array,
        collider: Collider,
        pose: RigidPose,
        x_internal: Array,
        settings: NewtonSettings = NewtonSettings(),
        x0: Array | None = None,
        linearised: QuadraticElasticity | None = None,
    ) -> Solution:
        """Baseline: elasticity linearised about x_internal, contact as it is. `linearised`, the elasticity that
        `QuadraticElasticity(elasticity, x_internal)` makes, spares its assembly where one state has many contacts."""
        linear = QuadraticElasticity(self.elasticity, x_internal) if linearised is None else linearised
        start = x_internal if x0 is None else x0
        return self._solve_contact(linear, rows, collider, pose, start, settings, x_internal)

    def _solve_contact(
        self,
        elastic: Elastic,
        rows: Array,
        collider: Collider,
        pose: RigidPose,
        x0: Array,
        settings: NewtonSettings,
        internal: Array | None,
    ) -> Solution:
        contact = SurfaceContact(self.contact, self._surface_nodes, self._surface_areas, collider, pose)
        start = self.constrained(rows, x0)
        floors = (
            max(_FORCE_FLOOR * float(np.linalg.norm(elastic.gradient(start))), 1e-9 * self.elasticity.force_scale),
            max(_FORCE_FLOOR**2 * abs(elastic.energy(start)), 1e-12 * self.elasticity.energy_scale),
        )
        reference = start if internal is None else internal
        energy = ContactEnergy(elastic, self._terms, contact, self.null_space, reference, floors)
        result = minimise(energy, self.null_space, start, settings)
        return self._solution(result, result.status, contact.max_depth(result.x), np.nan)

    def _solution(self, result: NewtonResult, status: Status, max_depth: float, min_eigenvalue: float) -> Solution:
        return Solution(
            x=result.x,
            status=status,
            residual=result.residual,
            decrement=result.decrement,
            newton_iterations=result.newton_iterations,
            cg_iterations=result.cg_iterations,
            min_det_F=self.elasticity.min_det_F(result.x),
            max_depth=max_depth,
            energy=result.energy,
            seconds=result.seconds,
            stable=status is not Status.UNSTABLE and result.negative_curvature is None,
            min_eigenvalue=min_eigenvalue,
        )
