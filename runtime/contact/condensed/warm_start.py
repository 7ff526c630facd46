"""Loads in balance at a state, foretold by those of a state nearby: where `contact_solve.py` starts from.

Of loads that bear pressure there, to first order: with dx and dF how they have moved, T how the collider has turned,
and dc what it carries a load along by,

    dr = (I + G_w D)^-1 (dx + dF v - dc + F G dphi),    dphi = (F + dF)^T T f - F^T f,
    de = -g . dr,    g + dg = T (g + H dr),

exact where body and collider move rigidly. A load that bore nothing, but has come into the collider since, came in
where it was outside, at a gap s there. So it starts as if that side were flat and the load alone,

    d = -s - g . (dx + dF v - dc),    k e^2 n . G_jj n = d,    n = (F + dF)^T T g,

for the nearest way out of where it is now may be on the other side of a thin wall.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array, IntArray
from runtime.compiled import compiled
from runtime.contact.condensed.contact_node_kernels import places
from runtime.contact.condensed.contact_solve import ContactProblem, ContactSolution
from runtime.contact.condensed.woodbury import WoodburyFactor

Floats = NDArray[np.floating[Any]]

# Loads that have moved by more than so many times what they are displaced by are in another contact.
_TOO_FAR = 2.0


class Pressed(Protocol):
    """The loads `index` (m,) in balance, k of them bearing pressure: a `ContactEquilibrium`."""

    @property
    def index(self) -> IntArray: ...

    @property
    def problem(self) -> ContactProblem: ...

    @property
    def solution(self) -> ContactSolution: ...

    @property
    def bearing(self) -> IntArray: ...

    @property
    def factor(self) -> WoodburyFactor: ...


def warm_start(
    press: Pressed, index: IntArray, problem: ContactProblem, follows: Array, turns: Array
) -> tuple[Array, Array] | None:
    """Penetrations (n,) and normals (n, dim) of the loads `index` (n,), those of the problem; None for a state too far
    away. press: of the state nearby, of m loads; follows: dc (m, dim) [m]; turns: T (dim, dim) or (m, dim, dim)."""
    b, there, solution = press.bearing, press.problem, press.solution
    g, pressure = solution.normal, solution.pressure
    turns = np.ascontiguousarray(np.broadcast_to(turns, (len(g), *turns.shape[-2:])))
    at = places(press.index, index)
    positions = problem.position, problem.F, there.position, there.F
    moved, turned = _carried(at, *positions, solution.given, follows, pressure, g, turns, b)
    if np.abs(moved[b]).max(initial=0.0) > _TOO_FAR * there.depth:
        return None
    if b.size:
        given = press.factor.carried(press.factor.given(turned.reshape(-1, 1)))
        moved[b] = press.factor.soften(moved[b].reshape(-1, 1) + given).reshape(len(b), -1)
    state = solution.left, pressure, g, solution.curvature
    return _start(at, *state, moved, turns, problem.F, problem.stiffness, problem.compliance)


@compiled
def _carried(
    at: IntArray,
    x: Array,
    F: Array,
    x_before: Array,
    F_before: Array,
    v: Array,
    follows: Array,
    pressure: Array,
    g: Array,
    turns: Array,
    bearing: IntArray,
) -> tuple[Array, Array]:
    """dx + dF v - dc (m, dim) of the m loads before, and dphi (k, dim) of those that bore pressure; those that are no
    longer asked for count as if they had gone with the collider."""
    m, dim = v.shape
    moved, turned = np.zeros((m, dim)), np.zeros((len(bearing), dim))
    for j in range(m):
        if at[j] < 0:
            continue
        for a in range(dim):
            moved[j, a] = x[at[j], a] - x_before[j, a] - follows[j, a]
            for b in range(dim):
                moved[j, a] += (F[at[j], a, b] - F_before[j, a, b]) * v[j, b]
    for k, j in enumerate(bearing):
        if at[j] < 0:
            continue
        for a in range(dim):
            along = 0.0
            for b in range(dim):
                along += turns[j, a, b] * g[j, b]
            for b in range(dim):
                turned[k, b] += pressure[j] * (F[at[j], a, b] * along - F_before[j, a, b] * g[j, a])
    return moved, turned


@compiled
def _start(
    at: IntArray,
    left: Array,
    pressure: Array,
    normal: Array,
    curvature: Array,
    moved: Array,
    turns: Array,
    F: Array,
    stiffness: Array,
    G: Floats,
) -> tuple[Array, Array]:
    """e (n,) and g (n, dim). Forces, as e^2, change linearly; a load that is about to let go keeps a little, so that it
    is seen."""
    dim = normal.shape[1]
    e, g = np.full(len(F), -np.inf), np.zeros((len(F), dim))
    bent, n = np.empty(dim), np.empty(dim)
    for j in range(len(at)):
        i, along = at[j], 0.0
        for a in range(dim):
            along += normal[j, a] * moved[j, a]
        if i < 0 or (pressure[j] <= 0.0 and left[j] <= along):
            continue
        for a in range(dim):
            bent[a] = normal[j, a]
            for b in range(dim):
                if pressure[j] > 0.0:
                    bent[a] += curvature[j, a, b] * moved[j, b]
        for a in range(dim):
            for b in range(dim):
                g[i, a] += turns[j, a, b] * bent[b]
        if pressure[j] > 0.0:
            e[i] = left[j] * np.sqrt(max(1.0 - 2.0 * along / left[j], 0.01))
            continue
        gives = 0.0
        for a in range(dim):
            n[a] = 0.0
            for b in range(dim):
                n[a] += F[i, b, a] * g[i, b]
        for a in range(dim):
            for b in range(dim):
                gives += n[a] * G[i * dim + a, i * dim + b] * n[b]
        if gives > 0.0:
            e[i] = np.sqrt((left[j] - along) / (stiffness[i] * gives))
    return e, g
