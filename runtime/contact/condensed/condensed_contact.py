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

from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.condensed.linearised_contact import LinearisedContact
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.candidate_search import CandidateSearch
from softprint.runtime.contact.solver.candidates import Candidates, NodeDistance, PosedCollider, merge
from softprint.runtime.contact.solver.contact_nodes import ContactNodes, CorotatedNodes
from softprint.runtime.contact.solver.contact_solve import ContactProblem, ContactSolution
from softprint.runtime.contact.solver.solved_contact import NearNodes, SolvedContact
from softprint.runtime.contact.solver.warm_start import WarmStart
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.local_compliance import LocalCompliance

# The dent can push more nodes into a collider, and these again others: at most so many searches for such nodes.
_SEARCHES = 3


@dataclass(frozen=True, eq=False)
class CondensedContact:
    """The contact of one body with colliders, by name. stiffness: a k (n_nodes,) [N/m^2] of the contact nodes."""

    nodes: ContactNodes
    compliance: LocalCompliance
    stiffness: Array
    searches: Mapping[str, CandidateSearch]

    @classmethod
    def of(
        cls,
        body: ReducedBody,
        mechanics: BodyMechanics,
        colliders: Mapping[str, Collider],
        stiffness: float,
        band: float = 0.0,
    ) -> CondensedContact:
        """stiffness: k of the penalty law [N/m^4]; band: [m], see `CandidateSearch`. Raises SoftprintError for
        mechanics without surface compliance."""
        compliance, condensation = mechanics.surface_compliance, mechanics.condensation
        mesh_nodes = compliance.nodes
        own = None if condensation is None else condensation.at(mesh_nodes)
        return cls(
            ContactNodes(body.node_points(mesh_nodes), own, body.handles, mesh_nodes),
            LocalCompliance(compliance.among_nodes()),
            stiffness * compliance.areas,
            {name: CandidateSearch(collider, band) for name, collider in colliders.items()},
        )

    def in_frame(self, frame_rows: Array) -> CorotatedNodes:
        """The contact nodes in the corotated frame of a step that starts at frame rows (n_rows, dim)."""
        return self.nodes.in_frame(frame_rows)

    def resume(self, solved: SolvedContact | None) -> WarmStart | None:
        """The warm start from the solved contact that a state stores."""
        return None if solved is None else WarmStart(solved, self.compliance, self.stiffness)

    def evaluate(
        self, nodes: CorotatedNodes, rows: Array, poses: Poses, warm_start: WarmStart | None
    ) -> ContactEvaluation:
        """The contact at handle rows (n_rows, dim) with the colliders at poses, by one contact solve. nodes: in the
        frame of the step. There may be several equilibria; the solve converges to the one nearest to the warm start."""
        return self.evaluation(nodes, rows, self._solve(nodes, rows, poses, warm_start))

    def evaluation(
        self, nodes: CorotatedNodes, rows: Array, solved: SolvedContact | None
    ) -> ContactEvaluation:
        """The evaluation of a contact that was already solved at these handle rows, in this frame."""
        start = self.resume(solved)
        contact = None if start is None else LinearisedContact(start, nodes)
        return ContactEvaluation(nodes, rows, tuple(self.searches), contact)

    def _solve(
        self, nodes: CorotatedNodes, rows: Array, poses: Poses, warm_start: WarmStart | None
    ) -> SolvedContact | None:
        near = self._candidates(nodes, rows, poses, warm_start)
        if not near:
            return None
        candidates, owner = merge(list(near.values()))
        colliders = tuple(PosedCollider(self.searches[name].collider, poses[name]) for name in near)
        distance = NodeDistance(colliders, owner)
        problem = self._problem(rows, candidates, distance)
        start = None
        if warm_start is not None:
            start = warm_start.predict(candidates.index[candidates.may_be_active], problem, poses)
            if start is None:  # the warm start is from a state too far away to be useful
                return self._solve(nodes, rows, poses, None)
        solution = problem.solve(start)
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
            frame_rows=nodes.frame_rows,
            poses={name: poses[name] for name in near},
            near={name: NearNodes(poses[name], own.index, own.position) for name, own in near.items()},
            index=candidates.index[candidates.may_be_active],
            owner=owner[candidates.may_be_active],
            position=problem.position,
            F=problem.F,
            depth=candidates.depth,
            solution=solution,
        )

    def _candidates(
        self, nodes: CorotatedNodes, rows: Array, poses: Poses, warm_start: WarmStart | None
    ) -> dict[str, Candidates]:
        """The candidates of every collider that the body touches."""
        bounded = nodes.bounded_positions(rows)
        last = None if warm_start is None else warm_start.solved
        found = {}
        for name, search in self.searches.items():
            active, depth = (None, 0.0) if last is None else (last.active_set(name), last.depth)
            near = search.find(nodes, rows, poses[name], bounded, active, depth)
            if near is not None:
                found[name] = near
        return found

    def _problem(self, rows: Array, candidates: Candidates, distance: NodeDistance) -> ContactProblem:
        """The contact problem of the nodes that may be active; distance: of all candidates."""
        which = candidates.may_be_active
        index = candidates.index[which]
        return ContactProblem(
            self.compliance.among(index),
            self.nodes.deformation(rows, index),
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
        distance: NodeDistance,
    ) -> BoolArray:
        """(n,) which of the candidates that were not in the problem are pushed into a collider by the dent."""
        b, pushed = solution.active, np.zeros(len(candidates.index), dtype=bool)
        # No other node is displaced farther than the active nodes.
        beside = ~candidates.may_be_active & (candidates.distance < solution.largest_displacement)
        if not beside.any():
            return pushed
        index, active = candidates.index[beside], candidates.index[candidates.may_be_active][b]
        force = kernels.pulled_back(problem.F[b], solution.pressure[b], solution.normal[b])
        v = self.compliance.displacement(index, active, force)
        moved = kernels.to_world(self.nodes.deformation(rows, index), v)
        pushed[beside] = distance.among(beside).value(candidates.position[beside] + moved) < 0.0
        return pushed
