"""Warm start of the contact solve: the contact forces of a state, predicted from those of a nearby solved state.

Active nodes are predicted to first order. With dx and dF the changes of their positions and deformation gradients, T
the rotation of the collider since then, and dc the displacement of a node that moves rigidly with the collider,

    dr = (I + G_w D)^-1 (dx + dF v - dc + F G dphi),    dphi = (F + dF)^T T f - F^T f,
    de = -g . dr,    g + dg = T (g + H dr),

which is exact where body and collider move rigidly. A node that was outside at a gap s and has since entered the
collider starts with the normal of the side where it entered, as if that side were flat and the node alone,

    d = -s - g . (dx + dF v - dc),    k e^2 n . G_jj n = d,    n = (F + dF)^T T g,

because the collider surface nearest to its present position may be on the other side of a thin wall.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.compiled import compiled
from softprint.runtime.contact.solver.contact_node_kernels import places
from softprint.runtime.contact.solver.contact_solve import ContactProblem, StartingPoint
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.contact.solver.woodbury import WoodburyFactor
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.local_compliance import LocalCompliance

Floats = NDArray[np.floating[Any]]

# Where nodes have moved by more than this multiple of the contact displacement, the warm start is not used.
_TOO_FAR = 2.0


@dataclass(frozen=True, eq=False)
class WarmStart:
    """A solved contact from which the contact solves of nearby states start. compliance: among the contact nodes of the
    body; stiffness: a k (n_nodes,) [N/m^2] of all of them."""

    solved: SolvedContact
    compliance: LocalCompliance
    stiffness: Array

    @lazy
    def factor(self) -> WoodburyFactor:
        """The Woodbury factorisation of the active nodes, for predictions, Hessians and sensitivities."""
        own = self.solved
        G = self.compliance.among(own.index)
        return WoodburyFactor(G, own.F, self.stiffness[own.index], own.solution)

    def predict(self, index: IntArray, problem: ContactProblem, poses: Poses) -> StartingPoint | None:
        """The starting point at the nodes `index` (n,) of the problem, with the colliders at poses; None for a state
        that is too far away."""
        near, solution = self.solved, self.solved.solution
        b, g, pressure = solution.active, solution.normal, solution.pressure
        follows, rotations = _with_colliders(near, poses)
        at = places(near.index, index)
        positions = problem.position, problem.F, near.position, near.F
        moved, force_change = _motion_and_force_change(
            at, *positions, solution.rest_displacement, follows, pressure, g, rotations, b
        )
        if np.abs(moved[b]).max(initial=0.0) > _TOO_FAR * near.depth:
            return None
        if b.size:
            factor = self.factor
            displacement = factor.to_world(factor.rest_displacement(force_change.reshape(-1, 1)))
            moved[b] = factor.relaxed(moved[b].reshape(-1, 1) + displacement).reshape(len(b), -1)
        state = solution.penetration, pressure, g, solution.curvature
        return _start(at, *state, moved, rotations, problem.F, problem.stiffness, problem.compliance)


def _with_colliders(near: SolvedContact, poses: Poses) -> tuple[Array, Array]:
    """dc (m, dim) [m] and T (m, dim, dim) of the nodes, by the motion of their colliders."""
    y = near.deformed_position
    follows, rotations = np.empty_like(y), np.empty((*y.shape, y.shape[1]))
    for number, name in enumerate(near.names):
        mine = slice(None) if len(near.names) == 1 else near.owner == number
        before, after = near.poses[name], poses[name]
        follows[mine] = after.apply(before.apply_inverse(y[mine])) - y[mine]
        rotations[mine] = after.rotation @ before.rotation.T
    return follows, rotations


@compiled
def _motion_and_force_change(
    at: IntArray,
    x: Array,
    F: Array,
    x_before: Array,
    F_before: Array,
    v: Array,
    follows: Array,
    pressure: Array,
    g: Array,
    rotations: Array,
    active: IntArray,
) -> tuple[Array, Array]:
    """dx + dF v - dc (m, dim) of the m nodes of the earlier contact, and dphi (k, dim) of its active nodes. Nodes that
    are not in the new problem (`at` is -1) count as moving rigidly with the collider."""
    m, dim = v.shape
    moved, force_change = np.zeros((m, dim)), np.zeros((len(active), dim))
    for j in range(m):
        if at[j] < 0:
            continue
        for a in range(dim):
            moved[j, a] = x[at[j], a] - x_before[j, a] - follows[j, a]
            for b in range(dim):
                moved[j, a] += (F[at[j], a, b] - F_before[j, a, b]) * v[j, b]
    for k, j in enumerate(active):
        if at[j] < 0:
            continue
        for a in range(dim):
            along = 0.0
            for b in range(dim):
                along += rotations[j, a, b] * g[j, b]
            for b in range(dim):
                force_change[k, b] += pressure[j] * (F[at[j], a, b] * along - F_before[j, a, b] * g[j, a])
    return moved, force_change


@compiled
def _start(
    at: IntArray,
    penetration: Array,
    pressure: Array,
    normal: Array,
    curvature: Array,
    moved: Array,
    rotations: Array,
    F: Array,
    stiffness: Array,
    G: Floats,
) -> tuple[Array, Array]:
    """The starting point e (n,) and g (n, dim). Forces, proportional to e^2, change linearly; a node that is about to
    lose contact keeps a small penetration, so that it stays in the active set."""
    dim = normal.shape[1]
    e, g = np.full(len(F), -np.inf), np.zeros((len(F), dim))
    gradient, n = np.empty(dim), np.empty(dim)
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
        compliance = 0.0
        for a in range(dim):
            n[a] = 0.0
            for b in range(dim):
                n[a] += F[i, b, a] * g[i, b]
        for a in range(dim):
            for b in range(dim):
                compliance += n[a] * G[i * dim + a, i * dim + b] * n[b]
        if compliance > 0.0:
            e[i] = np.sqrt((penetration[j] - along) / (stiffness[i] * compliance))
    return e, g
