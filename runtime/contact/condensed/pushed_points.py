"""Points that were not part of a contact solve, and that its dent pushes into a collider."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.contact.condensed.contact_group import ContactGroup
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.candidates import Candidates
from softprint.runtime.contact.solver.contact_point_kernels import are_among
from softprint.runtime.contact.solver.contact_solve import ContactProblem, ContactSolution


class _Forces(NamedTuple):
    """Those that make a dent: on contact nodes (k,), (k, dim) [N], in rest coordinates."""

    nodes: IntArray
    forces: Array


def with_pushed_in(
    group: ContactGroup, problem: ContactProblem, solution: ContactSolution
) -> ContactGroup | None:
    """The group with what the dent of its solution pushes in: more of its candidates, or points into further colliders.
    None where there is nothing."""
    pushed = pushed_in(group, problem, solution)
    if pushed.any():
        return group.with_possibly_active(pushed)
    further = [name for name in group.colliders.searches if name not in group.near]
    if not (further and solution.active.size):
        return None
    dent, bearing = _forces(group, problem, solution), group.index[solution.active]
    facets = _onto_facets(group, further, dent, bearing)
    sharp = _onto_sharp_points(group, further, dent)
    return group.with_further(facets, sharp) if facets or len(sharp) else None


def pushed_in(group: ContactGroup, problem: ContactProblem, solution: ContactSolution) -> BoolArray:
    """(n,) which of the candidates that were not in the problem of a group are pushed into their collider by the dent
    of its solution."""
    candidates = group.candidates
    pushed = np.zeros(len(candidates.index), dtype=bool)
    # Near the active points no other is displaced farther than these.
    beside = ~candidates.may_be_active & (candidates.distance < solution.largest_displacement)
    if not beside.any():
        return pushed
    moved = _displacement(group, candidates.index[beside], _forces(group, problem, solution))
    pushed[beside] = group.distance.among(beside).value(candidates.position[beside] + moved) < 0.0
    return pushed


def _onto_facets(
    group: ContactGroup, further: Sequence[str], dent: _Forces, bearing: IntArray
) -> dict[str, Candidates]:
    """The candidates on facets of those of the further colliders that a dent pushes points into, by name. bearing: (k,)
    the points that bear the forces of the dent."""
    farthest = group.together.compliance.farthest(*dent)
    found = {}
    for name in further:
        index, distance, x = group.colliders.closer(name, farthest)
        free = ~are_among(index, bearing)
        index, distance, x = index[free], distance[free], x[free]
        if not len(index):
            continue
        there = group.colliders.posed(name)(x + _displacement(group, index, dent))
        pushed = (there.value < 0.0) & group.colliders.face(index, there.gradient)
        if pushed.any():
            found[name] = Candidates(index, distance, x, 0.0, may_be_active=pushed)
    return found


def _onto_sharp_points(group: ContactGroup, further: Sequence[str], dent: _Forces) -> IntArray:
    """The points (k,), ascending, that a dent pushes onto sharp points of further colliders."""
    pressed, names = group.together.pressed, list(group.colliders.searches)
    if pressed is None:
        return np.empty(0, dtype=np.int64)
    x = group.every.positions(group.colliders.rows, pressed.index) + _displacement(group, pressed.index, dent)
    at = [group.colliders.poses[name] for name in names]
    inside = pressed.planes(slice(None)).placed(pressed.collider, at).value(x) < 0.0
    of_further = np.isin(pressed.collider, [names.index(name) for name in further])
    return np.asarray(pressed.index[inside & of_further])


def _forces(group: ContactGroup, problem: ContactProblem, solution: ContactSolution) -> _Forces:
    """The contact nodes (k,) that bear the forces of a solution, and these forces (k, dim) [N], in rest coordinates."""
    b = solution.active
    force = kernels.pulled_back(problem.carriers[b], solution.pressure[b], solution.normal[b])
    return _Forces(*group.together.compliance.on_nodes(group.index[b], force))


def _displacement(group: ContactGroup, index: IntArray, dent: _Forces) -> Array:
    """u (m, dim) [m] of points (m,) by the forces of a dent, in the world."""
    v = group.together.compliance.displacement(index, *dent)
    return kernels.to_world(group.every.carriers(group.colliders.rows, index), v)
