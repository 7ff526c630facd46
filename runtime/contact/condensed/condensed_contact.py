"""Condensed contact: the contact of a reduced step, with the displacement outside the subspace condensed out.

The contact displacement of a state is an equilibrium, so the energy of that displacement and of contact together is a
function of the reduced state alone, W(q); its gradient and Hessian are in `linearised_contact.py`. No cubature of the
body's volume has to resolve a dent. All colliders that the body touches are solved together: on the small Jelly two
balls pressed in 3 contact radii apart push back 11 % more than each alone, because what one pushes aside the other has
to push too, and 20 % less where their dents overlap. One collider is a group of one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.condensed.linearised_contact import LinearisedContact
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.candidate_search import CandidateSearch
from softprint.runtime.contact.solver.candidates import Candidates, PointDistance, PosedCollider, merge
from softprint.runtime.contact.solver.contact_points import ContactPoints, CorotatedPoints
from softprint.runtime.contact.solver.contact_solve import ContactProblem, ContactSolution
from softprint.runtime.contact.solver.solved_contact import NearPoints, SolvedContact
from softprint.runtime.contact.solver.warm_start import PointCompliance, WarmStart
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.interpolated_compliance import InterpolatedCompliance
from softprint.runtime.mechanics.loaded_points import LoadedPoints
from softprint.runtime.mechanics.local_compliance import LocalCompliance

# The dent can push more points into a collider, and these again others: at most so many searches for such points.
_SEARCHES = 3
# The way from a warm start is cut into at most 2 to that power parts.
_HALVINGS = 3


@dataclass(frozen=True, eq=False)
class CondensedContact:
    """The contact of one body with colliders, by name. loaded: where contact acts; nodes: (n_contact,) mesh indices of
    the contact nodes; points, compliance and stiffness: a k (n,) [N/m^2] of the contact points."""

    loaded: LoadedPoints
    nodes: IntArray
    points: ContactPoints
    compliance: PointCompliance
    stiffness: Array
    searches: Mapping[str, CandidateSearch]

    @classmethod
    def of(
        cls,
        body: ReducedBody,
        mechanics: BodyMechanics,
        colliders: Mapping[str, Collider],
        law: PenaltyContact,
        band: float = 0.0,
    ) -> CondensedContact:
        """law: contact is at the contact nodes, or on the facets between them; band: [m], see `CandidateSearch`. Raises
        SoftprintError for mechanics without surface compliance."""
        compliance = mechanics.surface_compliance
        loaded = LoadedPoints.of_compliance(body, compliance, law.reduced_points)
        of_nodes = LocalCompliance(compliance.among_nodes())
        return cls(
            loaded,
            compliance.nodes,
            ContactPoints.of(body, loaded, mechanics.condensation),
            of_nodes if loaded.are_nodes else InterpolatedCompliance(of_nodes, loaded),
            law.stiffness * loaded.areas,
            {name: CandidateSearch(collider, band) for name, collider in colliders.items()},
        )

    def in_frame(self, frame_rows: Array) -> CorotatedPoints:
        """The contact points in the corotated frame of a step that starts at frame rows (n_rows, dim)."""
        return self.points.in_frame(frame_rows)

    def resume(self, solved: SolvedContact | None) -> WarmStart | None:
        """The warm start from the solved contact that a state stores."""
        return None if solved is None else WarmStart(solved, self.compliance, self.stiffness)

    def evaluate(
        self, points: CorotatedPoints, rows: Array, poses: Poses, warm_start: WarmStart | None
    ) -> ContactEvaluation:
        """The contact at handle rows (n_rows, dim) with the colliders at poses, by one contact solve. points: in the
        frame of the step. There may be several equilibria; the solve converges to the one nearest to the warm start."""
        return self.evaluation(points, rows, self._solve(points, rows, poses, warm_start))

    def evaluation(
        self, points: CorotatedPoints, rows: Array, solved: SolvedContact | None
    ) -> ContactEvaluation:
        """The evaluation of a contact that was already solved at these handle rows, in this frame."""
        start = self.resume(solved)
        contact = None if start is None else LinearisedContact(start, points)
        return ContactEvaluation(self.loaded, self.nodes, points, rows, tuple(self.searches), contact)

    def _solve(
        self,
        points: CorotatedPoints,
        rows: Array,
        poses: Poses,
        warm_start: WarmStart | None,
        halvings: int = _HALVINGS,
    ) -> SolvedContact | None:
        """halvings: how often the way from the warm start may be cut in half, where Newton's method does not follow the
        contact along all of it."""
        near = self._candidates(points, rows, poses, warm_start)
        if not near:
            return None
        candidates, owner = merge(list(near.values()))
        colliders = tuple(PosedCollider(self.searches[name].collider, poses[name]) for name in near)
        distance = PointDistance(tuple(near), colliders, owner)
        problem = self._problem(rows, candidates, distance)
        if warm_start is None:
            solution = problem.solve()
        else:
            which = candidates.may_be_active
            start = warm_start.predict(candidates.index[which], problem, poses, distance.among(which))
            if start is None:  # the warm start is from a state too far away to be useful
                return self._solve(points, rows, poses, None)
            followed = problem.follow(start)
            if followed is None and halvings:
                last = warm_start.solved
                half = {name: last.poses.get(name, pose).towards(pose, 0.5) for name, pose in poses.items()}
                middle = self._solve(points, 0.5 * (last.rows + rows), half, warm_start, halvings - 1)
                return self._solve(points, rows, poses, self.resume(middle), halvings - 1)
            solution = problem.descend(start) if followed is None else followed
        for _ in range(_SEARCHES):
            pushed = self._pushed_in(rows, candidates, problem, solution, distance)
            if not pushed.any():
                break
            before, candidates = candidates.may_be_active, candidates.with_possibly_active(pushed)
            problem = self._problem(rows, candidates, distance)
            solution = problem.solve(solution.extended(before[candidates.may_be_active]))
        if not (solution.active.size or candidates.any_inside):
            return None
        return SolvedContact(
            rows=rows,
            frame_rows=points.frame_rows,
            poses={name: poses[name] for name in near},
            near={name: NearPoints(poses[name], own.index, own.position) for name, own in near.items()},
            index=candidates.index[candidates.may_be_active],
            owner=owner[candidates.may_be_active],
            position=problem.position,
            F=problem.F,
            depth=candidates.depth,
            solution=solution,
        )

    def _candidates(
        self, points: CorotatedPoints, rows: Array, poses: Poses, warm_start: WarmStart | None
    ) -> dict[str, Candidates]:
        """The candidates of every collider that the body touches."""
        bounded = points.bounded_positions(rows)
        last = None if warm_start is None else warm_start.solved
        found = {}
        for name, search in self.searches.items():
            active, depth = (None, 0.0) if last is None else (last.active_set(name), last.depth)
            near = search.find(points, rows, poses[name], bounded, active, depth)
            if near is not None:
                found[name] = near
        return found

    def _problem(self, rows: Array, candidates: Candidates, distance: PointDistance) -> ContactProblem:
        """The contact problem of the points that may be active; distance: of all candidates."""
        which = candidates.may_be_active
        index = candidates.index[which]
        return ContactProblem(
            self.compliance.among(index),
            self.points.deformation(rows, index),
            self.stiffness[index],
            candidates.position[which],
            candidates.depth,
            distance.among(which),
        )

    def _pushed_in(
        self,
        rows: Array,
        candidates: Candidates,
        problem: ContactProblem,
        solution: ContactSolution,
        distance: PointDistance,
    ) -> BoolArray:
        """(n,) which of the candidates that were not in the problem are pushed into a collider by the dent."""
        b, pushed = solution.active, np.zeros(len(candidates.index), dtype=bool)
        # No other point is displaced farther than the active points.
        beside = ~candidates.may_be_active & (candidates.distance < solution.largest_displacement)
        if not beside.any():
            return pushed
        index, active = candidates.index[beside], candidates.index[candidates.may_be_active][b]
        force = kernels.pulled_back(problem.F[b], solution.pressure[b], solution.normal[b])
        v = self.compliance.displacement(index, active, force)
        moved = kernels.to_world(self.points.deformation(rows, index), v)
        pushed[beside] = distance.among(beside).value(candidates.position[beside] + moved) < 0.0
        return pushed
