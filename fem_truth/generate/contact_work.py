"""One unit of work: a planned contact, solved at all its depths and returned as rows of the truth file's tables."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from softprint.fem_truth.generate.shards import Tables
from softprint.fem_truth.sampling.contact_approach import ContactApproaches
from softprint.fem_truth.sampling.contact_path import ContactPath, PathSample, node_speeds
from softprint.fem_truth.sampling.contact_plan import (
    DEPTHS_STREAM,
    SIDEWAYS_STREAM,
    ContactPlan,
    PlannedContact,
)
from softprint.fem_truth.sampling.depths import noisy_depths
from softprint.fem_truth.statics.constrained import ConstrainedProblem, Solution
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.arrays import Array
from softprint.runtime.colliders.approach import Approach, OutOfReach
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.truth.truth_schema import UNREACHED

_UNREACHED = "An earlier depth of the same contact did not converge, so there was nothing to start from."


@dataclass(frozen=True, eq=False)
class ContactWork:
    """Data shared by the contacts of a plan.

    approaches: of the contacts of the plan; rows: (n_states, n_rows, dim) of the states; depths: number per contact, up
    to the largest of its approach [m], with noise as a share of their step.
    """

    problem: ConstrainedProblem
    approaches: ContactApproaches
    rows: Array
    depths: int
    depth_noise: float
    settings: FullSpaceSettings
    _collider_points: dict[int, Array] = field(default_factory=dict)

    @property
    def plan(self) -> ContactPlan:
        return self.approaches.plan

    def solve(self, unit: int) -> Tables:
        """The tables `contacts` (one row), `samples` and `repeat` of a unit; row numbers start at 0 within the
        unit."""
        contact = self.plan[unit]
        approach, limits = self.approaches.of(contact)
        rng = self.plan.rng(DEPTHS_STREAM, contact)
        depths = noisy_depths(self.depths, limits.deepest, self.depth_noise, rng)
        path = ContactPath(
            self.problem,
            approach.collider,
            self.rows[contact.state],
            self.approaches.internal[contact.state],
            approach,
            self.settings,
        )
        again: list[Solution | None] = []
        unreached = _UNREACHED
        try:
            limits.require_depth(approach)
            samples = path.load(depths)
            again = path.from_the_side(samples, self._sideways(contact, approach)) if contact.repeated else []
        except OutOfReach as error:
            clear = approach.pose(approach.clear_of_surface)
            samples, unreached = [PathSample(depth, clear, None) for depth in depths], str(error)
        return self._tables(contact, approach, limits.thickness, samples, again, unreached)

    def _sideways(self, contact: PlannedContact, approach: Approach) -> Array:
        """A unit vector tangential to the surface at the place, drawn with the generator of this contact."""
        drawn = self.plan.rng(SIDEWAYS_STREAM, contact).standard_normal(len(approach.normal))
        along = drawn - (drawn @ approach.normal) * approach.normal
        return along / np.linalg.norm(along)

    def _tables(
        self,
        contact: PlannedContact,
        approach: Approach,
        thickness: float,
        samples: list[PathSample],
        again: list[Solution | None],
        unreached: str,
    ) -> Tables:
        internal = self.approaches.internal[contact.state]
        first = [_displacement(sample.solution, internal) for sample in samples]
        second = [_displacement(solution, internal) for solution in again]
        speed = node_speeds(first, np.array([sample.depth for sample in samples]))
        seconds = sum(sample.work.seconds for sample in samples)
        seconds += sum(solution.seconds for solution in again if solution is not None)
        contacts = {
            "unit": [contact.unit],
            "state": [contact.state],
            "collider": [contact.collider],
            "place": [self.approaches.places[contact.state, contact.place]],
            "rotation_index": [contact.rotation],
            "rotation": [approach.rotation],
            "direction": [-approach.normal],
            "thickness": [thickness],
            "seconds": [seconds],
        }
        columns = {
            "contact": [0] * len(samples),
            "depth_index": range(len(samples)),
            "depth": [sample.depth for sample in samples],
            "pose_rotation": [sample.pose.rotation for sample in samples],
            "pose_translation": [sample.pose.translation for sample in samples],
            "displacement": _stacked(first, internal.shape),
            "status": [_status(sample.solution) for sample in samples],
            "reason": [
                unreached if sample.solution is None else sample.solution.reason for sample in samples
            ],
            "branch_flag": [sample.jumped for sample in samples],
            "node_speed": speed,
            "newton_iterations": [sample.work.newton_iterations for sample in samples],
            "cg_iterations": [sample.work.cg_iterations for sample in samples],
            "seconds": [sample.work.seconds for sample in samples],
        }
        unknown = np.full(self.problem.body.rest_rows.shape, np.nan)
        columns["handle_force"] = [
            unknown if sample.solution is None else sample.solution.handle_force for sample in samples
        ]
        for measure in ("residual", "decrement", "min_det_F", "max_depth", "energy"):
            columns[measure] = [
                np.nan if sample.solution is None else getattr(sample.solution, measure) for sample in samples
            ]
        columns["intrusion"] = [self._intrusion(contact.collider, approach, sample) for sample in samples]
        repeat = {
            "sample": list(range(len(again))),
            "displacement": _stacked(second, internal.shape),
            "status": [_status(solution) for solution in again],
            "spread": [_spread(u1, u2) for u1, u2 in zip(first, second, strict=False)],
        }
        return {
            name: {key: np.asarray(column) for key, column in table.items()}
            for name, table in (("contacts", contacts), ("samples", columns), ("repeat", repeat))
        }

    def _intrusion(self, number: int, approach: Approach, sample: PathSample) -> float:
        """How deep the collider lies inside the body [m]; NaN if there is no equilibrium."""
        if not sample.converged or sample.solution is None:
            return np.nan
        if number not in self._collider_points:
            self._collider_points[number] = surface_points(approach.collider)
        points = sample.pose.apply(self._collider_points[number])
        return intrusion(points, self.problem.body.mesh, sample.solution.x).depth


def _displacement(solution: Solution | None, internal: Array) -> Array | None:
    """Contact displacement [m], or None if there is no equilibrium."""
    return solution.x - internal if solution is not None and solution.converged else None


def _stacked(displacements: list[Array | None], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """(n, n_nodes, dim) in the precision of the file, NaN for samples without an equilibrium."""
    stacked = np.full((len(displacements), *shape), np.nan, dtype=np.float32)
    for row, displacement in zip(stacked, displacements, strict=True):
        if displacement is not None:
            row[:] = displacement
    return stacked


def _status(solution: Solution | None) -> int:
    return UNREACHED if solution is None else int(solution.status)


def _spread(first: Array | None, second: Array | None) -> float:
    if first is None or second is None:
        return float("nan")
    return float(np.linalg.norm(second - first) / np.linalg.norm(first))
