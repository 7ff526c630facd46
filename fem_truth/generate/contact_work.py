"""One unit of work: a planned contact, solved at all its depths and returned as rows of the truth file's tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from softprint.fem_truth.generate.shards import Tables
from softprint.fem_truth.sampling.contact_path import ContactPath, PathSample, node_speeds
from softprint.fem_truth.sampling.contact_plan import (
    DEPTHS_STREAM,
    SIDEWAYS_STREAM,
    TURN_STREAM,
    ContactPlan,
    PlannedContact,
)
from softprint.fem_truth.sampling.depths import noisy_depths
from softprint.fem_truth.sampling.rotations import random_rotation
from softprint.fem_truth.statics.constrained import ConstrainedProblem, Solution
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.approach import Approach, OutOfReach
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.mesh import Mesh
from softprint.runtime.mesh.facet_lattice import facet_lattice
from softprint.runtime.truth.truth_schema import UNREACHED

# Of the points on facets at which the depth of a collider is measured, relative to its size.
_SPACING = 1.0 / 60.0
_UNREACHED = "An earlier depth of the same contact did not converge, so there was nothing to start from."


@dataclass(frozen=True, eq=False)
class ContactWork:
    """Data shared by the contacts of a plan.

    colliders: those of the plan, each built at its first use; rows: (n_states, n_rows, dim) and internal:
    (n_states, n_nodes, dim) internal equilibria [m] of the states; places: (n_states, n_places) mesh nodes; rotations:
    (n_rotations, dim, dim), None if the colliders are not rotated; depths: number per contact, up to max_depth [m],
    with noise as a share of their step; on_facets: whether contact is, and depths are measured, on facets too.
    """

    problem: ConstrainedProblem
    colliders: Sequence[Callable[[], Collider]]
    plan: ContactPlan
    rows: Array
    internal: Array
    places: IntArray
    rotations: Array | None
    depths: int
    max_depth: float
    depth_noise: float
    settings: FullSpaceSettings
    on_facets: bool = False
    _surfaces: dict[int, tuple[Array, Array]] = field(default_factory=dict)
    _collider_points: dict[int, Array] = field(default_factory=dict)

    def solve(self, unit: int) -> Tables:
        """The tables `contacts` (one row), `samples` and `repeat` of a unit; row numbers start at 0 within the
        unit."""
        contact = self.plan[unit]
        approach = self._approach(contact)
        thickness = approach.thickness(self.max_depth)
        deepest = min(self.max_depth, thickness)
        depths = noisy_depths(self.depths, deepest, self.depth_noise, self.plan.rng(DEPTHS_STREAM, contact))
        path = ContactPath(
            self.problem,
            approach.collider,
            self.rows[contact.state],
            self.internal[contact.state],
            approach,
            self.settings,
        )
        again: list[Solution | None] = []
        unreached = _UNREACHED
        try:
            samples = path.load(depths)
            again = path.from_the_side(samples, self._sideways(contact, approach)) if contact.repeated else []
        except OutOfReach as error:
            clear = approach.pose(approach.clear_of_surface)
            samples, unreached = [PathSample(depth, clear, None) for depth in depths], str(error)
        return self._tables(contact, approach, thickness, samples, again, unreached)

    def _approach(self, contact: PlannedContact) -> Approach:
        """Aimed at the place on the deformed surface of the internal equilibrium, along its normal there."""
        mesh, place = self.problem.body.mesh, self.places[contact.state, contact.place]
        if contact.state not in self._surfaces:
            deformed = Mesh(self.internal[contact.state], mesh.cells)
            self._surfaces[contact.state] = deformed.points[mesh.surface_nodes], deformed.surface_normals
        nodes, normals = self._surfaces[contact.state]
        aimed = int(np.searchsorted(mesh.surface_nodes, place))
        # The set is rotated as a whole for each state and place: it stays evenly spread, and no two places have the
        # same rotations.
        rotation = np.eye(mesh.dim)
        if self.rotations is not None:
            turn = random_rotation(mesh.dim, self.plan.rng_of_place(TURN_STREAM, contact))
            rotation = self.rotations[contact.rotation] @ turn
        collider = self.colliders[contact.collider]()
        surface = nodes
        if self.on_facets:
            surface = np.vstack(
                [nodes, self._on_facets(contact.state, collider, nodes[aimed], normals[aimed])]
            )
        return Approach(collider, surface, nodes[aimed], normals[aimed], rotation)

    def _on_facets(self, state: int, collider: Collider, place: Array, normal: Array) -> Array:
        """(k, dim) [m] Points on the facets that the collider can meet on its line: what is finer than the mesh goes in
        between its nodes, and its depth counts from where contact on facets begins."""
        x, facets = self.internal[state], self.problem.body.mesh.facets
        reach = float(np.linalg.norm(np.maximum(np.abs(collider.lower), np.abs(collider.upper))))
        if not np.isfinite(reach):  # a half space meets nodes first
            return np.empty((0, x.shape[1]))
        middles = x[facets].mean(axis=1)
        extent = np.linalg.norm(x[facets] - middles[:, None], axis=2).max(axis=1)
        away = middles - place
        beside = np.linalg.norm(away - (away @ normal)[:, None] * normal, axis=1)
        return facet_lattice(x, facets[beside < reach + extent], _SPACING * collider.size)

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
        internal = self.internal[contact.state]
        first = [_displacement(sample.solution, internal) for sample in samples]
        second = [_displacement(solution, internal) for solution in again]
        speed = node_speeds(first, np.array([sample.depth for sample in samples]))
        seconds = sum(sample.work.seconds for sample in samples)
        seconds += sum(solution.seconds for solution in again if solution is not None)
        contacts = {
            "unit": [contact.unit],
            "state": [contact.state],
            "collider": [contact.collider],
            "place": [self.places[contact.state, contact.place]],
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
