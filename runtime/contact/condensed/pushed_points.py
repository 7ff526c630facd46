"""Points that were not part of a contact solve, and that its dent pushes into a collider."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.candidates import Candidates, PointDistance
from softprint.runtime.contact.solver.contact_points import CorotatedPoints
from softprint.runtime.contact.solver.contact_solve import ContactProblem, ContactSolution
from softprint.runtime.mechanics.compliance.interpolated_compliance import InterpolatedCompliance


def pushed_in(
    points: CorotatedPoints,
    compliance: InterpolatedCompliance,
    rows: Array,
    candidates: Candidates,
    problem: ContactProblem,
    solution: ContactSolution,
    distance: PointDistance,
) -> BoolArray:
    """(n,) which of the candidates that were not in the problem are pushed into a collider by the dent of its solution.
    rows: handle rows (n_rows, dim); distance: of all candidates."""
    b, pushed = solution.active, np.zeros(len(candidates.index), dtype=bool)
    # No other point is displaced farther than the active points.
    beside = ~candidates.may_be_active & (candidates.distance < solution.largest_displacement)
    if not beside.any():
        return pushed
    index, active = candidates.index[beside], candidates.index[candidates.may_be_active][b]
    force = kernels.pulled_back(problem.carriers[b], solution.pressure[b], solution.normal[b])
    v = compliance.displacement(index, *compliance.on_nodes(active, force))
    moved = kernels.to_world(points.carriers(rows, index), v)
    pushed[beside] = distance.among(beside).value(candidates.position[beside] + moved) < 0.0
    return pushed
