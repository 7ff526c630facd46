"""The contact points of a body near each of several colliders, at one state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.solver.candidate_search import CandidateSearch
from softprint.runtime.contact.solver.candidates import Candidates, PosedCollider, merge
from softprint.runtime.contact.solver.contact_points import CorotatedPoints
from softprint.runtime.contact.solver.contact_solve_kernels import to_world
from softprint.runtime.contact.solver.solved_contact import SolvedContact


@dataclass(frozen=True, eq=False)
class NearColliders:
    """searches: of each collider, by name; points: on the facets, at handle rows (n_rows, dim); poses: of the
    colliders."""

    searches: Mapping[str, CandidateSearch]
    points: CorotatedPoints
    rows: Array
    poses: Poses

    def candidates(self, last: SolvedContact | None) -> dict[str, Candidates]:
        """Of every collider that some of the points are inside, or were pushed into in the last contact."""
        bounded = self.points.bounded_positions(self.rows)
        found = {}
        for name, search in self.searches.items():
            active, depth = (None, 0.0) if last is None else (last.active_set(name), last.depth)
            near = search.find(self.points, self.rows, self.poses[name], bounded, active, depth)
            if near is not None:
                found[name] = near
        return found

    def closer(self, name: str, distance: float) -> tuple[IntArray, Array, Array]:
        """The points (m,) closer to a collider than a distance [m], their signed distance (m,) [m] and position (m,
        dim) [m]."""
        bounded = self.points.bounded_positions(self.rows)
        return self.searches[name].closer(self.points, self.rows, self.poses[name], distance, bounded)

    def posed(self, name: str) -> PosedCollider:
        """A collider at its pose."""
        return PosedCollider(self.searches[name].collider, self.poses[name])

    def merged(self, near: Mapping[str, Candidates]) -> tuple[Candidates, IntArray]:
        """The candidates of some of them together, by name, and their owners, by their places there."""
        posed = [self.posed(name) for name in near]
        return merge(list(near.values()), lambda n, index, x: self.face(index, posed[n](x).gradient))

    def face(self, index: IntArray, normal: Array) -> BoolArray:
        """Which of the points (m,) colliders face from outside of the body, whose outward directions there are normal
        (m, dim)."""
        surface = to_world(self.points.carriers(self.rows, index), self.points.surface_normals(index))
        return np.asarray(np.einsum("ia,ia->i", surface, normal) < 0.0)
