"""The energy of one step in full space by the nodes of the body and the twists of the colliders that move freely.

    E(x, poses) = E_body(x) + sum W_contact(x, pose) + E_free(poses)

E_body is that of `full_space_step_energy.py`, and E_free (inertia, weight, contact between colliders) that of reduced
models (`runtime/dynamics/free_bodies.py`). A step of Newton's method solves

    [ A    B ] [ d ]     [ g ]
    [ B^T  C ] [ w ] = - [ t ]

for the displacement d of the nodes and the twists w, few in number. They are eliminated,

    (A - B C^-1 B^T) d = -(g - B C^-1 t),        w = -C^-1 (t + B^T d),

so that conjugate gradients run over the nodes alone. Where C is not positive definite, the joint matrix has negative
curvature, and a convex one takes its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular

from softprint.fem_truth.dynamics.full_space_state import FullSpaceState
from softprint.fem_truth.dynamics.full_space_step_energy import StepEnergy
from softprint.fem_truth.dynamics.full_space_surface import DeformedBody
from softprint.fem_truth.energy.moving_contact import CoupledContact, MovingContact
from softprint.fem_truth.energy.total_energy import Gradient
from softprint.fem_truth.linalg.block_matrix import Eliminated
from softprint.fem_truth.linalg.projected_cg import projected_cg
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.lagged_friction import NEARLY_BALANCED, LaggedFriction, SlipStart
from softprint.runtime.dynamics.free_bodies import FreeStep
from softprint.runtime.dynamics.pierced_colliders import FreeColliderLimit
from softprint.runtime.dynamics.state import Configuration

# Of a convex matrix of the free colliders alone: its smallest eigenvalue, as a share of the largest.
_LEAST_CURVATURE = 1e-9


class JointStep(NamedTuple):
    """nodes: (n_nodes, dim) [m]; twists: (n,), with angles scaled to metres."""

    nodes: Array
    twists: Array


class JointGradient(NamedTuple):
    """body: of all terms, by the nodes; twists: (n,) [N], of all terms; scale: the largest of the forces on free
    colliders that balance one another there [N]."""

    body: Gradient
    twists: Array
    scale: float

    @property
    def whole(self) -> Array:
        """(n_nodes, dim) [N] by the nodes."""
        return self.body.whole

    @property
    def norm(self) -> float:
        """Of the projected gradient by the nodes and that by the twists."""
        return float(np.hypot(self.body.norm, np.linalg.norm(self.twists)))


@dataclass(frozen=True, eq=False)
class JointDirection:
    """See `CgResult`."""

    step: JointStep
    slope: float
    iterations: int
    negative_curvature: bool
    direction: Array | None


class FreeBodyEnergy:
    """A `Problem` of Newton's method over configurations whose rows are the positions of all nodes.

    body: without friction updates of its own and without contact with free colliders; contacts: with these; slip: from
    where it is measured, None without friction; limit: where the line search may go.
    """

    def __init__(
        self,
        body: StepEnergy,
        free: FreeStep,
        contacts: Sequence[MovingContact],
        slip: SlipStart | None,
        friction_updates: int,
        limit: FreeColliderLimit[DeformedBody],
    ) -> None:
        self._body, self._free, self._contacts, self._slip, self.limit = body, free, contacts, slip, limit
        self.lagged: LaggedFriction | None = None
        # The call of `lag_friction` at the start counts as the first update.
        self._updates_left = 0 if slip is None else friction_updates - 1
        self.noise = body.noise

    def start(self, candidates: Sequence[Array], end: Configuration) -> Configuration:
        """Where the minimisation begins: of the given positions of the nodes those with the least energy, and the free
        colliders moved by their momenta until they meet an obstacle; or with all where they are at poses. Sharp points
        press what they are nearest to there."""
        self._body.lag_friction(end.rows)
        begin = self._free.carried_on(end.poses, 0.0)
        found = [self._free.start(x, end.poses, self._energy_of_poses) for x in candidates]
        allowed = [at for at in found if self.allows(at)] or [Configuration(end.rows, begin)]
        energies = [self._energy(at) for at in allowed]
        start = allowed[int(np.argmin(energies))]
        self._energy(start)  # holds the sharp points there
        return start

    def _energy(self, at: Configuration) -> float:
        """All of it, without friction between colliders [J], with the sharp points held there."""
        self._body.hold(at.rows)
        return self._body.evaluate(at.rows)[0] + self._energy_of_poses(at)

    def _energy_of_poses(self, at: Configuration) -> float:
        """What depends on the poses, without friction [J], with the sharp points held there."""
        for contact in self._contacts:
            contact.at(at.poses[contact.name]).hold(at.rows)
        touching = sum(c.at(at.poses[c.name]).energy(at.rows) for c in self._contacts)
        return touching + self._free.energy(at.poses, None)

    def lag_friction(self, at: Configuration) -> None:
        """Update the normal forces of friction to those at a configuration."""
        if self._slip is None:
            return
        self._body.lag_friction(at.rows)
        for contact in self._contacts:
            contact.lag(at.rows, at.poses[contact.name])
        between = self._free.bodies.contact.lag(at.poses, self._slip)
        self.lagged = LaggedFriction(self._slip, {}, {}, {}, between)

    def evaluate(self, at: Configuration) -> tuple[float, JointGradient]:
        """E [J] and its gradient."""
        energy, body = self._body.evaluate(at.rows)
        free, units = self._free, self._free.bodies.units
        alone, centres = free.alone(at.poses, self.lagged), free.bodies.centres(at.poses)
        energy += alone.energy
        by_contact, touching = np.zeros_like(at.rows), alone.touching.copy()
        for contact in self._contacts:
            where = at.rows, at.poses[contact.name]
            energy += sum(contact.energies(*where))
            by_nodes, by_twist = contact.gradient(*where, centres[contact.name])
            by_contact += by_nodes
            touching[free.bodies.slot(contact.name)] += by_twist
        pressed = self._body.null_space_at(at.rows).project(by_contact)
        projected = body.projected + pressed
        norm = float(np.linalg.norm(projected))
        scales = (pressed, units * alone.flying, units * touching)
        scale = max(free.floor, *(float(np.linalg.norm(part)) for part in scales))
        whole = Gradient(body.elastic, body.whole + by_contact, projected, norm)
        return energy, JointGradient(whole, units * (alone.flying + touching), scale)

    def second_derivatives(
        self, at: Configuration, convex: bool
    ) -> tuple[list[CoupledContact], IntArray, Array, Array]:
        """Of contact with each free collider; the nodes (k,) in contact with any, and B (k*dim, n) of their coordinates
        and the twists; C (n, n); with angles scaled to metres."""
        free, bodies = self._free, self._free.bodies
        centres, dim = bodies.centres(at.poses), at.rows.shape[1]
        contacts = [c.coupled(at.rows, at.poses[c.name], centres[c.name], convex) for c in self._contacts]
        nodes = np.unique(np.concatenate([contact.nodes for contact in contacts]))
        B, own = np.zeros((len(nodes), dim, bodies.size)), np.zeros((bodies.size, bodies.size))
        for contact in contacts:
            k = len(contact.nodes)
            mixed, twisted = free.coupled([contact.coupling], k * dim)
            B[np.searchsorted(nodes, contact.nodes)] += mixed.reshape(k, dim, bodies.size)
            own += twisted
        alone = free.alone(at.poses, self.lagged).hessian
        scaled = bodies.units[:, None] * bodies.units
        C = scaled * own + (_convex(scaled * alone) if convex else scaled * alone)
        return contacts, nodes, B.reshape(-1, bodies.size) * bodies.units, C

    def direction(
        self,
        at: Configuration,
        gradient: JointGradient,
        tolerance: float,
        max_iterations: int,
        convex: bool = False,
    ) -> JointDirection:
        """Newton's step at a configuration where the gradient is this."""
        contacts, nodes, B, C = self.second_derivatives(at, convex)
        still = np.zeros_like(at.rows)
        try:
            factor = cholesky(C, lower=True)
        except LinAlgError:
            return JointDirection(JointStep(still, np.zeros(len(C))), 0.0, 0, True, None)
        matrix = self._body.hessian(at.rows, convex)
        null_space = self._body.null_space_at(at.rows, gradient.whole, convex)
        for contact in contacts:
            for facets, blocks in contact.blocks:
                matrix.add_facets(facets, blocks)
        k, dim = len(nodes), at.rows.shape[1]
        if k:
            W = solve_triangular(factor, B.T, lower=True).T
            matrix.eliminated = Eliminated(nodes, W.reshape(k, dim, -1))
        passed_on = still.copy()
        passed_on[nodes] = (B @ cho_solve((factor, True), gradient.twists)).reshape(k, dim)
        slope = gradient.body.projected - null_space.project(passed_on)
        moved, iterations, negative, way = still, 0, False, None
        # The residual of the twists is zero, so that of the nodes may be this share of their own gradient.
        enough, size = tolerance * gradient.norm, float(np.linalg.norm(slope))
        if size > enough:
            cg = projected_cg(matrix, slope, null_space, enough / size, max_iterations)
            moved, iterations, negative, way = cg.step, cg.iterations, cg.negative_curvature, cg.direction
        twists = -cho_solve((factor, True), gradient.twists + B.T @ moved[nodes].ravel())
        step = JointStep(moved, twists)
        return JointDirection(step, self.slope(gradient, step), iterations, negative, way)

    def moved(self, at: Configuration, step: JointStep, length: float) -> Configuration:
        """The configuration after a step of this length."""
        poses = self._free.bodies.retract(at.poses, length * step.twists)
        return Configuration(self._body.moved(at.rows, step.nodes, length), poses)

    def longest(self, at: Configuration, step: JointStep) -> float:
        """1, or less where free colliders could otherwise pass through something."""
        return self._free.longest(at, step.twists)

    def allows(self, at: Configuration) -> bool:
        """Whether no free collider pierces the body deeper than allowed."""
        return self.limit.allows(DeformedBody(at))

    def slope(self, gradient: JointGradient, step: JointStep) -> float:
        """The slope of E along a step [J]."""
        by_nodes = self._body.null_space.share.dot(gradient.body.projected, step.nodes)
        return by_nodes + float(gradient.twists @ step.twists)

    def stepped(
        self,
        at: Configuration,
        step: JointStep,
        length: float,
        before: JointGradient,
        after: JointGradient,
    ) -> bool:
        """See `TotalEnergy.stepped`. Normal forces between rigid surfaces change by multiples of themselves before
        forces balance: friction is updated where they nearly do."""
        changed = [self._body.stepped(at.rows, step.nodes, length, before.body, after.body)]
        changed += [c.at(at.poses[c.name]).accepted(at.rows) for c in self._contacts]
        if self._updates_left == 0 or after.norm > NEARLY_BALANCED * self.force_scale(at, after):
            return any(changed)
        self._updates_left -= 1
        self.lag_friction(at)
        return True

    def force_scale(self, at: Configuration, gradient: JointGradient) -> float:
        """The largest of the forces that balance one another [N]."""
        return max(self._body.force_scale(at.rows, gradient.body), gradient.scale)

    def energy_scale(self, at: Configuration) -> float:
        """See `StepEnergy.energy_scale`."""
        return self._body.energy_scale(at.rows)


def _convex(matrix: Array) -> Array:
    """With the magnitudes of the eigenvalues."""
    values, vectors = np.linalg.eigh(matrix)
    values = np.abs(values)
    return np.asarray((vectors * np.maximum(values, _LEAST_CURVATURE * values.max())) @ vectors.T)


def slip_start(state: FullSpaceState, time_step: float) -> SlipStart:
    """The start of a step of time_step [s], for the friction between colliders."""

    def no_contact_points(index: IntArray, of: ContactEvaluation) -> Array:
        raise NotImplementedError("there is no condensed contact in full space")

    return SlipStart(
        np.empty((0, state.x.shape[1])), state.poses, time_step, no_contact_points, lambda: state.x
    )
