"""Warm start of the contact solve: the contact forces of a state, predicted from those of a nearby solved state.

Active points are predicted to first order. With dx and dA the changes of their positions and carriers, T the rotation
of the collider since then, and dc the displacement of a point that moves rigidly with the collider,

    dr = (I + G_w D)^-1 (dx + dA v - dc + A G dphi),    dphi = (A + dA)^T T f - A^T f,
    de = -g . dr,    g + dg = T (g + H dr),

which is exact where body and collider move rigidly. A point that was outside at a gap s and has since entered the
collider starts with the normal of the side where it entered, as if that side were flat and those that enter were alone,

    d = -s - g . (dx + dA v - dc),    sum_j n_i . G_ij n_j k e_j^2 = d_i,    n = (A + dA)^T T g,

because the collider surface nearest to its present position may be on the other side of a thin wall. So does a point
that was not looked at before: its gap is that of its present position, displaced by the earlier forces, to the collider
where it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.compiled import compiled
from softprint.runtime.contact.solver.candidates import PointDistance, carried
from softprint.runtime.contact.solver.contact_point_kernels import places
from softprint.runtime.contact.solver.contact_points import CorotatedPoints
from softprint.runtime.contact.solver.contact_solve import ContactProblem, StartingPoint
from softprint.runtime.contact.solver.contact_solve_kernels import compliance_along, pulled_back, to_world
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.contact.solver.woodbury import WoodburyFactor
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.compliance.interpolated_compliance import InterpolatedCompliance

# Points between nodes hardly move apart: the compliance among them is regularised by this fraction of its diagonal.
_DAMPED = 0.1
# Of the force that a point which enters would need alone, the least that it starts with.
_LEAST = 0.01
# Where points have moved by more than this multiple of the contact displacement, nothing is predicted.
TOO_FAR = 2.0


class _Earlier(NamedTuple):
    """m points in an earlier contact: e (m,) [m], p (m,) [N], g (m, dim) and H (m, dim, dim) [1/m]; moved: (m, dim) [m]
    since then, less the motion of their colliders; rotations: T (m, dim, dim)."""

    penetration: Array
    pressure: Array
    normal: Array
    curvature: Array
    moved: Array
    rotations: Array


@dataclass(frozen=True, eq=False)
class WarmStart:
    """A solved contact from which the contact solves of nearby states start. compliance: among the contact points of
    the body; stiffness: a k (n,) [N/m^2] of all of them; frame: of the step in which it was solved, None if that is
    over."""

    solved: SolvedContact
    compliance: InterpolatedCompliance
    stiffness: Array
    frame: CorotatedPoints | None = None

    def is_within(self, points: CorotatedPoints) -> bool:
        """Whether it was solved in the step in whose frame these points are."""
        return self.frame is not None and self.frame.step is points.step

    @lazy
    def factor(self) -> WoodburyFactor:
        """The Woodbury factorisation of the active points, for predictions, Hessians and sensitivities."""
        own = self.solved
        G = self.compliance.among(own.index)
        return WoodburyFactor(G, own.carriers, self.stiffness[own.index], own.solution)

    @lazy
    def node_forces(self) -> tuple[IntArray, Array]:
        """The contact nodes (k,) that bear forces, and these (k, dim) [N], in rest coordinates."""
        return self.compliance.on_nodes(self.solved.active, self.solved.rest_force)

    def predict(
        self,
        index: IntArray,
        problem: ContactProblem,
        poses: Poses,
        after: PointDistance,
        compliance: InterpolatedCompliance,
    ) -> StartingPoint | None:
        """The starting point at the points `index` (n,) of the problem, with the colliders at poses; None for a state
        that is too far away. after: the distance of these points; compliance: among them."""
        near, solution = self.solved, self.solved.solution
        b, g, pressure = solution.active, solution.normal, solution.pressure
        before, now = ([at[name] for name in near.names] for at in (near.poses, poses))
        follows, rotations = carried(near.deformed_position, near.owner, before, now)
        at = places(near.index, index)
        positions = problem.position, problem.carriers, near.position, near.carriers
        moved, force_change = _motion_and_force_change(
            at, *positions, solution.rest_displacement, follows, pressure, g, rotations, b
        )
        if np.abs(moved[b]).max(initial=0.0) > TOO_FAR * near.depth:
            return None
        if b.size:
            factor = self.factor
            displacement = factor.to_world(factor.rest_displacement(force_change.reshape(-1, 1)))
            moved[b] = factor.relaxed(moved[b].reshape(-1, 1) + displacement).reshape(len(b), -1)
        state = _Earlier(solution.penetration, pressure, g, solution.curvature, moved, rotations)
        new = np.flatnonzero(places(index, near.index) < 0)
        if b.size and new.size:
            v = compliance.displacement(index[new], *self.node_forces)
            beside = self._beside(v, new, problem, after)
            at = np.concatenate([at, new])
            state = _Earlier(*map(np.concatenate, zip(state, beside, strict=True)))
        return _start(at, state, problem)

    def held(self, index: IntArray, problem: ContactProblem, poses: Poses) -> StartingPoint:
        """The starting point with the earlier forces, which turn with their colliders, and nothing predicted: where the
        surface is about to slide off a tip, a prediction can be far off."""
        near, solution = self.solved, self.solved.solution
        before, now = ([at[name] for name in near.names] for at in (near.poses, poses))
        _, rotations = carried(near.deformed_position, near.owner, before, now)
        normal, curvature = solution.normal, solution.curvature
        state = _Earlier(
            solution.penetration, solution.pressure, normal, curvature, np.zeros_like(normal), rotations
        )
        at = places(near.index, index)
        return _start(at, state, problem)

    def _beside(self, v: Array, at: IntArray, problem: ContactProblem, after: PointDistance) -> _Earlier:
        """Points that were not in the earlier contact, numbers `at` (n,) of the problem: at their present positions,
        displaced by v (n, dim) [m] in rest coordinates, that of the earlier forces, and with the colliders where they
        were."""
        near, after = self.solved, after.among(at)
        y = problem.position[at] + to_world(problem.carriers[at], v)
        before = after.at(near.poses)
        distance = before(y)
        follows, rotations = carried(y, after.owner, before.poses, after.poses)
        nothing = np.zeros(len(at))
        return _Earlier(-distance.value, nothing, distance.gradient, distance.hessian, -follows, rotations)


@compiled
def _motion_and_force_change(
    at: IntArray,
    x: Array,
    A: Array,
    x_before: Array,
    A_before: Array,
    v: Array,
    follows: Array,
    pressure: Array,
    g: Array,
    rotations: Array,
    active: IntArray,
) -> tuple[Array, Array]:
    """dx + dA v - dc (m, dim) of the m points of the earlier contact, and dphi (k, dim) of its active points. Points
    that are not in the new problem (`at` is -1) count as moving rigidly with the collider."""
    m, dim = v.shape
    moved, force_change = np.zeros((m, dim)), np.zeros((len(active), dim))
    for j in range(m):
        if at[j] < 0:
            continue
        for a in range(dim):
            moved[j, a] = x[at[j], a] - x_before[j, a] - follows[j, a]
            for b in range(dim):
                moved[j, a] += (A[at[j], a, b] - A_before[j, a, b]) * v[j, b]
    for k, j in enumerate(active):
        if at[j] < 0:
            continue
        for a in range(dim):
            along = 0.0
            for b in range(dim):
                along += rotations[j, a, b] * g[j, b]
            for b in range(dim):
                force_change[k, b] += pressure[j] * (A[at[j], a, b] * along - A_before[j, a, b] * g[j, a])
    return moved, force_change


def _start(at: IntArray, earlier: _Earlier, problem: ContactProblem) -> StartingPoint:
    """The starting point e (n,) and g (n, dim) of a problem, with the points `at` (m,) in it, -1 for none."""
    e, g, gap = _carried_on(at, *earlier, len(problem.position))
    entering = np.flatnonzero(gap < 0.0)
    if len(entering):
        n = pulled_back(problem.carriers[entering], np.ones(len(entering)), g[entering])
        among = compliance_along(problem.compliance, entering, n)
        e[entering] = np.sqrt(_pushed_out(among, gap[entering]) / problem.stiffness[entering])
    return e, g


@compiled
def _carried_on(
    at: IntArray,
    penetration: Array,
    pressure: Array,
    normal: Array,
    curvature: Array,
    moved: Array,
    rotations: Array,
    n: int,
) -> tuple[Array, Array, Array]:
    """The starting point e (n,) and g (n, dim) of points that bore pressure, and the gaps (n,) of those that enter,
    negative. Forces, proportional to e^2, change linearly; a point that is about to lose contact keeps a small
    penetration, so that it stays in the active set."""
    dim = normal.shape[1]
    e, g = np.full(n, -np.inf), np.zeros((n, dim))
    gradient, gap = np.empty(dim), np.zeros(n)
    for j in range(len(at)):
        i, along = at[j], 0.0
        for a in range(dim):
            along += normal[j, a] * moved[j, a]
        if i < 0 or (pressure[j] <= 0.0 and penetration[j] <= along):
            continue
        for a in range(dim):
            gradient[a] = normal[j, a]
            for b in range(dim):
                if pressure[j] > 0.0:
                    gradient[a] += curvature[j, a, b] * moved[j, b]
        for a in range(dim):
            for b in range(dim):
                g[i, a] += rotations[j, a, b] * gradient[b]
        if pressure[j] > 0.0:
            e[i] = penetration[j] * np.sqrt(max(1.0 - 2.0 * along / penetration[j], 0.01))
            continue
        gap[i] = along - penetration[j]
    return e, g, gap


def _pushed_out(K: Array, gap: Array) -> Array:
    """The forces (k,) [N] that together push points (k,) back by -gap along their normals, at least a small part of
    what each would need alone. K: (k, k) [m/N] the compliance along these."""
    own = np.diag(K)
    alone = np.where(own > 0.0, -gap / np.where(own > 0.0, own, 1.0), 0.0)
    if len(K) < 2 or not (own > 0.0).all():
        return np.asarray(alone)
    together = np.linalg.solve(K + _DAMPED * np.diag(own), -gap)
    return np.minimum(np.maximum(together, _LEAST * alone), alone)
