"""The energy whose minimum is the next state (thesis eqs. 4.5 and 5.5).

    E(rows) = 1/(2 h^2) tr((rows - rows*)^T M (rows - rows*)) - tr(weight^T rows) + springs   (quadratic)
            + W_elastic(rows) + W_contact(rows) + friction(rows),   rows* = rows_old + h rows_velocity_old,

M = U^T diag(node_mass) U. W_contact is condensed contact, or penalty at the (corrected) surface samples. Corrections
are quasi-static: they have no inertia, and those of colliders no weight. Internal corrections and static condensation
have weight. Rotations are held at those of the start of the step (`frame.py`). The unknowns are the free minimal
coordinates v of `Handles.retract`; with T = d rows/dv the chain rule is

    gradient = T^T dE/drows,    Hessian = T^T (d2E/drows2) T + curvature of the retraction.

Colliders that move freely add their twists to the unknowns, and their inertia, weight and contacts to the energy
(`free_bodies.py`).

The sum, Newton's matrix, is formed in `StepPoint.linearisation` and factorised in `runtime/optimise/descent.py`. Its
parts by the rows come from

    condensed contact    `LinearisedContact.hessian`             runtime/contact/linearised/linearised_contact.py
    contact of frames    `FrameContactEvaluation.linearise`      runtime/dynamics/terms/frame_contact.py
    penalty contact      `SurfaceContactEvaluation.linearise`    runtime/dynamics/terms/surface_contact.py
    elasticity           `ElasticEvaluation.linearise`           runtime/dynamics/terms/elastic.py
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array, IntArray, RowHessian, known_hessian
from softprint.runtime.body.handles import Handles
from softprint.runtime.contact.collider_coupling import Coupling, Link
from softprint.runtime.contact.condensed.condensed_friction import CondensedFrictionEvaluation
from softprint.runtime.contact.contact_force import ContactForce, FrictionForces
from softprint.runtime.contact.lagged_friction import LaggedFriction, SlipStart
from softprint.runtime.dynamics.free_bodies import FreeStep
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.dynamics.terms.springs import QuadraticForm
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.lazy import lazy
from softprint.runtime.optimise import Linearisation

# Energies are sums of some thousand float64 terms: differences below this fraction of their size are round-off.
_ROUND_OFF = 1e-13
# The same for energies that depend on float32 networks.
_SINGLE_ROUND_OFF = 1e-8


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns of a body in a step: its free minimal coordinates. free: (n_free,) their indices; units: (n_free,) 1
    for lengths, 1/lever [1/m] for angles, so that all unknowns are in metres and all gradients in newtons."""

    handles: Handles
    free: IntArray
    units: Array

    @property
    def all_free(self) -> bool:
        """Whether no handle is kinematic."""
        return len(self.free) == self.handles.n_dofs

    @property
    def are_rows(self) -> bool:
        """Whether the unknowns are the handle rows themselves: all handles are free points."""
        return not self.handles.frames and self.all_free

    def retract(self, rows: Array, v: Array) -> Array:
        """Rows after the increment v (n_free,)."""
        increment = np.zeros(self.handles.n_dofs)
        increment[self.free] = v * self.units
        return self.handles.retract(rows, increment)

    def tangent(self, rows: Array) -> Array:
        """T (n_rows*dim, n_free)."""
        tangent = self.handles.tangent(rows)
        return (tangent if self.all_free else tangent[:, self.free]) * self.units

    def pulled_back(self, rows: Array, gradient: Array) -> Array:
        """T^T dE/drows (n_free,)."""
        by_dofs = self.handles.pulled_back(rows, gradient)
        return (by_dofs if self.all_free else by_dofs[self.free]) * self.units

    def curvature(self, rows: Array, gradient: Array) -> Array:
        """The curvature of the retraction along the gradient (n_rows, dim): (n_free, n_free)."""
        curvature = self.handles.curvature(rows, gradient)[np.ix_(self.free, self.free)]
        return np.asarray(self.units[:, None] * curvature * self.units)


class IterateLimit(Protocol):
    """A condition that every iterate of a step must meet."""

    def allows(self, body: BodyEvaluation) -> bool:
        """Whether an iterate may be taken."""
        ...


@dataclass(frozen=True, eq=False)
class StepEnergy:
    """The `Problem` of one step (`runtime/optimise`); its points are `StepPoint`s, which compute every part of the
    energy once.

    quadratic: inertia, gravity and springs; springs: these alone; blocks: the matrix of `quadratic` for all axes
    (n_rows*dim, n_rows*dim); free_bodies: colliders that are solved for, None if all poses are prescribed; lagged: see
    `LaggedFriction`, None without friction; force_floor [N]: smaller forces count as balanced; energy_floor [J]:
    smaller differences are round-off; limit: iterates that it does not allow are not taken.
    """

    unknowns: Unknowns
    quadratic: QuadraticForm
    springs: QuadraticForm
    blocks: Array
    free_bodies: FreeStep | None
    lagged: LaggedFriction | None
    force_floor: float
    energy_floor: float
    timings: Timings
    limit: IterateLimit | None = None

    def point(self, body: BodyEvaluation) -> StepPoint:
        """The point of an evaluated body."""
        return StepPoint(self, body)

    def retract(self, x: StepPoint, v: Array) -> StepPoint:
        """The point after the increment v (n_free + twists,) of the free coordinates and of the free colliders. Its
        contact solve starts from that of x."""
        return self.point(x.body.near(self.moved(x.body.at, v)))

    def moved(self, at: Configuration, v: Array) -> Configuration:
        """A configuration after the increment v."""
        own = len(self.unknowns.free)
        rows = self.unknowns.retract(at.rows, v[:own])
        if self.free_bodies is None:
            return Configuration(rows, at.poses)
        return Configuration(rows, self.free_bodies.bodies.retract(at.poses, v[own:]))

    def longest(self, x: StepPoint, v: Array) -> float:
        """1, or less where contact could not be followed, or free colliders could pass through something."""
        own, rows = len(self.unknowns.free), x.body.at.rows
        contact = x.body.contact
        share = 1.0 if contact is None else contact.longest(self.unknowns.retract(rows, v[:own]) - rows)
        if self.free_bodies is None:
            return share
        return min(share, self.free_bodies.longest(x.body.at, v[own:]))

    def energy(self, x: StepPoint) -> float:
        """E [J], including lagged friction; infinite where the limit refuses x."""
        if self.limit is not None and not self.limit.allows(x.body):
            return np.inf
        return x.energy

    def linearise(self, x: StepPoint) -> Linearisation:
        """E, gradient [N] and Hessian [N/m]."""
        return x.linearisation

    def lag(self, x: StepPoint, start: SlipStart, last: FrictionForces | None = None) -> LaggedFriction:
        """The lagged friction, with the normal forces at x. last: friction of condensed contact that is near, from
        which it settles; None for zero."""
        body, terms = x.body, x.body.frame.terms
        # A linearisation follows: field corrections are evaluated once, with their Jacobians.
        _, contact = body.field, body.contact
        with self.timings.contact:
            points = (
                {}
                if contact is None or terms.condensed_friction is None
                else terms.condensed_friction.lag(contact, body.at.poses, start, last)
            )
            free = self.free_bodies
            bodies = {} if free is None else free.bodies.contact.lag(body.at.poses, start)
            return LaggedFriction(start, *body.surface.lag(start), points, bodies)

    def slope(self, body: BodyEvaluation, contact: Array) -> Array:
        """The gradient (n_free,) [N] at a state of the body, with the contact gradient (n_free,) of another state."""
        rows, elasticity, field = body.at.rows, body.elastic, body.field
        with self.timings.elastic:
            gradient, _ = elasticity.linearise(field)
        with self.timings.solve:
            gradient = gradient + self.quadratic.gradient(rows)
            if body.correction_weight is not None:
                gradient += body.correction_weight.gradient
            return self.unknowns.pulled_back(rows, gradient) + contact


@dataclass(frozen=True, eq=False)
class StepPoint:
    """A point of the minimisation, with everything that was computed there."""

    problem: StepEnergy
    body: BodyEvaluation

    @lazy
    def energy(self) -> float:
        """E [J]."""
        problem, body = self.problem, self.body
        elastic, contact, surface = body.elastic.energy, body.contact, body.surface
        with problem.timings.contact:
            touching = surface.energy + self._friction_energy
            touching += 0.0 if contact is None else contact.energy
            touching += 0.0 if body.frames is None else body.frames.energy
            if problem.free_bodies is not None:
                touching += problem.free_bodies.energy(body.at.poses, problem.lagged)
        return problem.quadratic.energy(body.at.rows) + body.correction_height + elastic + touching

    @lazy
    def _friction_energy(self) -> float:
        """Friction energy between body and colliders [J]."""
        lagged, body = self.problem.lagged, self.body
        if lagged is None:
            return 0.0
        total, condensed = body.surface.friction_energy(lagged), self._condensed_friction
        return total if condensed is None else total + condensed.energy

    @lazy
    def _condensed_friction(self) -> CondensedFrictionEvaluation | None:
        """Friction at the points of condensed contact; None without any."""
        lagged, condensed = self.problem.lagged, self.body.frame.terms.condensed_friction
        if condensed is None or lagged is None:
            return None
        return condensed.evaluate(lagged.points, *self.body.at, lagged.start.time_step)

    @lazy
    def contact_gradient(self) -> Array:
        """The gradient of contact and friction of the body (n_free,) [N]."""
        return self.problem.unknowns.pulled_back(self.body.at.rows, self._contact[0])

    @lazy
    def _contact(self) -> tuple[Array, list[RowHessian], list[Coupling], list[Link]]:
        """Contact and friction of the body: gradient by the rows, Hessians to be summed, and the couplings with free
        colliders."""
        problem, body, lagged = self.problem, self.body, self.problem.lagged
        rows, poses = body.at
        field, contact, surface = body.field, body.contact, body.surface
        with problem.timings.contact:
            free = problem.free_bodies
            centres = {} if free is None else free.bodies.centres(poses)
            gradient, hessian, couplings = surface.linearise(field, lagged, centres, len(rows))
            hessians = [] if hessian is None else [known_hessian(hessian)]
            links: list[Link] = []
            if contact is not None:
                gradient = gradient + contact.gradient
                hessians += [] if contact.hessian is None else [contact.hessian]
                more, links = contact.couplings(centres)
                couplings += more
            if body.frames is not None:
                slope, bearing, more = body.frames.linearise(centres)
                gradient, couplings = gradient + slope, couplings + more
                hessians += [] if bearing is None else [known_hessian(bearing)]
            if self._condensed_friction is not None:
                slope, sliding, more = self._condensed_friction.linearise(centres)
                gradient, couplings = gradient + slope, couplings + more
                hessians += [] if sliding is None else [known_hessian(sliding)]
        return gradient, hessians, couplings, links

    @lazy
    def linearisation(self) -> Linearisation:
        """E, gradient [N] and Hessian [N/m]; the scale is the largest of the forces that balance one another."""
        problem, body = self.problem, self.body
        timings, unknowns, rows = problem.timings, problem.unknowns, body.at.rows
        by_contact, hessians, couplings, links = self._contact
        elasticity = body.elastic
        with timings.elastic:
            by_elastic, elastic_hessian = elasticity.linearise(body.field)
        with timings.solve:
            by_quadratic = problem.quadratic.gradient(rows)
            hanging = body.correction_weight
            if hanging is not None:
                by_quadratic = by_quadratic + hanging.gradient
            parts = [unknowns.pulled_back(rows, part) for part in (by_quadratic, by_elastic)]
            parts.append(self.contact_gradient)
            slope = by_quadratic + by_elastic + by_contact

        def hessian() -> Array:
            with timings.solve:
                along = None if unknowns.are_rows else unknowns.tangent(rows)
                total = known_hessian(problem.blocks)(along) + unknowns.curvature(rows, slope)
                if hanging is not None:
                    total += hanging.hessian(along)
            with timings.elastic:
                total += body.elastic_hessian(elastic_hessian, unknowns.free, along)
            with timings.contact:
                for contact_hessian in hessians:
                    total += contact_hessian(along)
            return total

        quadratic = problem.quadratic.energy(rows) + body.correction_height
        elastic = elasticity.energy
        with timings.contact:
            contact = body.surface.energy + self._friction_energy
            contact += 0.0 if body.contact is None else body.contact.energy
            contact += 0.0 if body.frames is None else body.frames.energy
        single = body.frame.terms.points.corrected
        found = Linearisation(
            energy=quadratic + elastic + contact,
            noise=problem.energy_floor
            + _ROUND_OFF * (abs(problem.quadratic.constant) + abs(quadratic))
            + (_SINGLE_ROUND_OFF if single else _ROUND_OFF) * (elastic + contact),
            gradient=parts[0] + parts[1] + parts[2],
            second_derivative=hessian,
            scale=max(*(float(np.linalg.norm(part)) for part in parts), problem.force_floor),
        )
        free = problem.free_bodies
        if free is None:
            return found
        tangent = unknowns.tangent(rows)
        return free.joined(found, body.at.poses, couplings, links, tangent, problem.lagged, timings)

    @property
    def friction_on_nodes(self) -> FrictionForces | None:
        """The friction forces of condensed contact on the body; None without any."""
        return None if self._condensed_friction is None else self._condensed_friction.node_forces

    @property
    def contact_converged(self) -> bool:
        """Whether the contact solve, and that of friction on points that give way, have converged."""
        contact, friction = self.body.contact, self._condensed_friction
        return (contact is None or contact.converged) and (friction is None or friction.converged)

    def contacts(self) -> tuple[float, float, dict[str, ContactForce]]:
        """Contact energy and friction energy [J], including those between colliders; the force of the body on each
        collider."""
        problem, body, lagged = self.problem, self.body, self.problem.lagged
        contact, free = body.contact, problem.free_bodies
        with problem.timings.contact:
            normal, forces = body.surface.energy, body.surface.forces(lagged)
            if contact is not None:
                normal += contact.energy
                own: Mapping[str, ContactForce] = contact.forces()
                if self._condensed_friction is not None:
                    own = self._condensed_friction.added_to(own)
                forces |= own
            if body.frames is not None:
                normal, forces = normal + body.frames.energy, body.frames.added_to(forces)
            among = (0.0, 0.0) if free is None else free.among(body.at.poses, lagged)
        return normal + among[0], self._friction_energy + among[1], forces


def by_axis(matrix: Array, dim: int) -> Array:
    """matrix (x) I (n*dim, n*dim) of a matrix (n, n) that acts on every axis equally."""
    n = len(matrix)
    blocks = np.zeros((n, dim, n, dim))
    for axis in range(dim):
        blocks[:, axis, :, axis] = matrix
    return blocks.reshape(n * dim, n * dim)
