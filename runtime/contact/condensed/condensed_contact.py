"""Condensed contact: the contact of a reduced step, with the displacement outside the subspace condensed out.

The contact displacement of a state is an equilibrium, so the energy of that displacement and of contact together is a
function of the reduced state alone, W(q); its gradient and Hessian are in `runtime/contact/linearised/`. No cubature
of the body's volume has to resolve a dent. All colliders that the body touches are solved together: on the small Jelly
two balls pressed in 3 contact radii apart push back 6 % more than each alone, because what one pushes aside the other
has to push too, and 21 % less where their dents overlap. One collider is a group of one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.condensed.all_points import AllPoints
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.condensed.contact_group import ContactGroup
from softprint.runtime.contact.condensed.near_colliders import NearColliders
from softprint.runtime.contact.condensed.pushed_points import with_pushed_in
from softprint.runtime.contact.dents.dent_energies import DentCells
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.solver.candidate_search import CandidateSearch
from softprint.runtime.contact.solver.candidates import PosedCollider, carried
from softprint.runtime.contact.solver.contact_point_kernels import are_among
from softprint.runtime.contact.solver.contact_points import ContactPoints, CorotatedPoints
from softprint.runtime.contact.solver.pressed_points import PressedPoints
from softprint.runtime.contact.solver.sharp_search import Dent, SharpSearch, bearing_facets, sharp_colliders
from softprint.runtime.contact.solver.solved_contact import NearPoints, SolvedContact
from softprint.runtime.contact.solver.warm_start import WarmStart
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.compliance.interpolated_compliance import InterpolatedCompliance
from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance
from softprint.runtime.mechanics.loaded_points import Gaps, LoadedPoints, owners

# The dent can push more points into a collider, and these again others: at most so many searches for such points.
_SEARCHES = 3
# A way from a warm start that is too long for a prediction is cut in half at most so often.
_HALVINGS = 2
# The points that sharp points press are found again this often at most, at the start of a step.
_FINDS = 3
# A prediction with so many times the energy of the last contact, if that had any, is one of another contact.
_GROWN = 12.0


@dataclass(frozen=True, eq=False)
class CondensedContact:
    """The contact of one body with colliders, by name. loaded: where contact acts on the facets; nodes: (n_contact,)
    mesh indices of the contact nodes; points and compliance: of the points on the facets; stiffness: a k (n,) [N/m^2]
    of these, and of those that sharp points of the colliders press; sharp: searches for the latter, None where no
    collider has any; learned: None for the energy of linear mechanics; dent_cells: in which the energies of dents are,
    None where nothing is learned."""

    loaded: LoadedPoints
    nodes: IntArray
    points: ContactPoints
    of_nodes: LocalCompliance
    compliance: InterpolatedCompliance
    stiffness: Array
    searches: Mapping[str, CandidateSearch]
    sharp: SharpSearch | None
    learned: LearnedEnergy | None
    dent_cells: DentCells | None
    _last: list[AllPoints] = field(default_factory=list, repr=False)

    @classmethod
    def of(
        cls,
        body: ReducedBody,
        mechanics: BodyMechanics,
        colliders: Mapping[str, Collider],
        law: PenaltyContact,
        band: float = 0.0,
        learned: LearnedEnergy | None = None,
        internal: InternalField | None = None,
    ) -> CondensedContact:
        """law: contact is at the contact nodes, or on the facets between them; band: [m], see `CandidateSearch`;
        learned: None for the energy of linear mechanics; internal: correction of the body. Raises SoftprintError for
        mechanics without surface compliance."""
        compliance = mechanics.surface_compliance
        loaded = LoadedPoints.of_compliance(body, compliance, law.reduced_points)
        of_nodes = LocalCompliance(compliance.among_nodes())
        stiffness, sharp = law.stiffness * loaded.areas, None
        known = sharp_colliders(colliders, law, body.mesh, partial(Gaps.of, body, loaded, compliance))
        if known:
            owner = owners(body, compliance.nodes)
            corners = np.unique(bearing_facets(body.mesh.facets, owner))
            points = ContactPoints.of(body, loaded, mechanics.condensation, corners, internal)
            sharp = SharpSearch(body, known, owner, of_nodes, points, corners)
            stiffness = np.concatenate([stiffness, law.stiffness * sharp.areas])
        else:
            points = ContactPoints.of(body, loaded, mechanics.condensation, None, internal)
        return cls(
            loaded,
            compliance.nodes,
            points,
            of_nodes,
            InterpolatedCompliance(of_nodes, loaded),
            stiffness,
            {name: CandidateSearch(collider, band) for name, collider in colliders.items()},
            sharp,
            learned,
            None if learned is None else DentCells.of(body, mechanics),
        )

    @property
    def colliders(self) -> dict[str, Collider]:
        """By name."""
        return {name: search.collider for name, search in self.searches.items()}

    def in_frame(self, frame_rows: Array) -> CorotatedPoints:
        """The contact points on the facets in the corotated frame of a step that starts at frame rows (n_rows, dim)."""
        return self.points.in_frame(frame_rows)

    def resume(self, solved: SolvedContact | None, frame: CorotatedPoints | None = None) -> WarmStart | None:
        """The warm start from the solved contact that a state stores. frame: of the step in which it was solved."""
        if solved is None:
            return None
        together = self.all_points(solved.pressed)
        return WarmStart(solved, together.compliance, together.stiffness, frame)

    def node_forces(self, solved: SolvedContact, which: BoolArray | None = None) -> tuple[IntArray, Array]:
        """The contact nodes (k,), ascending, that bear the forces of a solved contact, of some of its active points
        (m,), all by default, and these forces (k, dim) [N], in rest coordinates."""
        index, force = solved.active, solved.rest_force
        if which is not None:
            index, force = index[which], force[which]
        return self.all_points(solved.pressed).loaded.to_nodes(index, force)

    def moved(self, points: CorotatedPoints, rows: Array, poses: Poses, solved: SolvedContact) -> float:
        """How far [m] at most an active point of a solved contact moves beside its collider from there to handle rows
        (n_rows, dim), with the colliders at poses, without contact displacement."""
        b, names = solved.solution.active, solved.names
        x = self.all_points(solved.pressed).in_frame(points).positions(rows, solved.active)
        before, after = ([at[name] for name in names] for at in (solved.poses, poses))
        follows, _ = carried(solved.deformed_position[b], solved.owner[b], before, after)
        return float(np.linalg.norm(x - solved.position[b] - follows, axis=1).max(initial=0.0))

    def all_points(self, pressed: PressedPoints | None) -> AllPoints:
        """All contact points, while sharp points of colliders press some (`SolvedContact.pressed`). The last are kept;
        this affects the cost and never the result."""
        if pressed is None or self.sharp is None:
            return AllPoints(None, self.loaded, self.compliance, self.stiffness, None)
        last = self._last[0] if self._last else None  # read once, as another thread may replace it
        if last is None or last.pressed is not pressed:
            loaded = self.loaded.followed_by(pressed.index, pressed.nodes, pressed.shares)
            compliance = InterpolatedCompliance(self.of_nodes, loaded)
            stiffness = self.stiffness.copy()
            stiffness[pressed.index] *= pressed.area_share
            last = AllPoints(pressed, loaded, compliance, stiffness, self.sharp.surface.pressed(pressed))
            self._last[:] = [last]
        return last

    def evaluate(
        self, points: CorotatedPoints, rows: Array, poses: Poses, warm_start: WarmStart | None
    ) -> ContactEvaluation:
        """The contact at handle rows (n_rows, dim) with the colliders at poses, by one contact solve. points: in the
        frame of the step; in its first evaluation contact is solved again as long as its dent moves the pressed points.
        There may be several equilibria; the solve converges to the one nearest to the warm start."""
        solved = self._solve(points, rows, poses, warm_start)
        for _ in range(_FINDS if warm_start is None or not warm_start.is_within(points) else 0):
            pressed = None if solved is None else self._moved_on(points, poses, solved)
            if pressed is None:
                break
            solved = self._solve(points, rows, poses, self.resume(solved), pressed) or solved
        return self.evaluation(points, rows, solved)

    def evaluation(
        self, points: CorotatedPoints, rows: Array, solved: SolvedContact | None
    ) -> ContactEvaluation:
        """The evaluation of a contact that was already solved at these handle rows, in this frame."""
        loaded, every, contact = self.loaded, points, None
        start = self.resume(solved, points)
        if solved is not None and start is not None:
            together = self.all_points(solved.pressed)
            loaded, every = together.loaded, together.in_frame(points)
            colliders = (
                PosedCollider(self.searches[name].collider, solved.poses[name]) for name in solved.names
            )
            contact = LinearisedContact(start, every, tuple(colliders))
        names = tuple(self.searches)
        return ContactEvaluation(
            loaded, self.nodes, points, every, rows, names, contact, self.learned, self.dent_cells
        )

    def _solve(
        self,
        points: CorotatedPoints,
        rows: Array,
        poses: Poses,
        warm_start: WarmStart | None,
        pressed: PressedPoints | None = None,
        halvings: int = _HALVINGS,
    ) -> SolvedContact | None:
        """pressed: the points that sharp points of the colliders press, None where these are to be found; halvings: how
        often the way from the warm start may be cut in half where it is too long for a prediction. Where Newton's
        method loses the contact it is cut once: finer parts hardly ever end elsewhere."""
        colliders = NearColliders(self.searches, points, rows, poses)
        last = None if warm_start is None else warm_start.solved
        if pressed is None:
            pressed = self._pressed(points, rows, poses, warm_start, points.bounded_positions(rows)[0])
        bore = np.empty(0, dtype=np.int64) if last is None else last.active
        group = ContactGroup.of(colliders, self.all_points(pressed), colliders.candidates(last), bore)
        if group is None:
            return None
        tight = self.learned is not None
        problem = group.problem(tight)
        if warm_start is None:
            solution, followed = problem.solve(), False
        else:
            start = warm_start.predict(group.index, problem, poses, group.among, group.together.compliance)
            if start is None:
                return self._from_afar(points, rows, poses, warm_start, halvings)
            found = problem.follow(start, _GROWN * warm_start.solved.solution.energy or np.inf)
            followed = found is not None
            if found is None and halvings:
                return self._in_halves(points, rows, poses, warm_start, 0)
            if found is None:
                held = warm_start.held(group.index, problem, poses)
                found = problem.descend(problem.lowest(start, held))
            solution = found
        for _ in range(_SEARCHES if solution.converged else 0):
            wider = with_pushed_in(group, problem, solution)
            if wider is None:
                break
            before, group = group.index, wider
            problem = group.problem(tight)
            solution = problem.solve(solution.extended(are_among(group.index, before)))
            if not solution.converged:
                break
        if not (solution.active.size or group.candidates.any_inside):
            return None
        return SolvedContact(
            rows=rows,
            frame_rows=points.frame_rows,
            poses=dict(poses),
            near={name: NearPoints(poses[name], own.index, own.position) for name, own in group.near.items()},
            index=group.index,
            owner=group.among.owner,
            position=problem.position,
            carriers=problem.carriers,
            depth=group.candidates.depth,
            solution=solution,
            pressed=pressed,
            followed=followed,
        )

    def _in_halves(
        self, points: CorotatedPoints, rows: Array, poses: Poses, warm_start: WarmStart, halvings: int
    ) -> SolvedContact | None:
        """The contact followed from the warm start to the middle of the way, of body and colliders, and on from there.
        halvings: see `_solve`, of both parts."""
        last = warm_start.solved
        half = {name: last.poses.get(name, pose).towards(pose, 0.5) for name, pose in poses.items()}
        middle = self._solve(points, 0.5 * (last.rows + rows), half, warm_start, None, halvings)
        end = self._solve(points, rows, poses, self.resume(middle, points), None, halvings)
        return end if end is None or middle is None or middle.followed else replace(end, followed=False)

    def _from_afar(
        self, points: CorotatedPoints, rows: Array, poses: Poses, warm_start: WarmStart, halvings: int
    ) -> SolvedContact | None:
        """The contact where the warm start is from a state too far away to predict from: followed in parts, or, where
        that is lost, whichever has the least energy of what was found there and of the contact without the warm start,
        in which the body may be on the wrong side of a thin wall."""
        found = []
        for more in range(halvings):
            end = self._in_halves(points, rows, poses, warm_start, more)
            if end is not None and end.followed:
                return end
            found += [] if end is None else [end]
        anew = self._solve(points, rows, poses, None)
        return None if anew is None else min([anew, *found], key=lambda end: end.solution.energy)

    def _pressed(
        self, points: CorotatedPoints, rows: Array, poses: Poses, warm_start: WarmStart | None, x: Array
    ) -> PressedPoints | None:
        """The points that sharp points of the colliders press: the same during a step. x: approximate positions of the
        contact points on the facets."""
        if self.sharp is None:
            return None
        if warm_start is None:
            return self.sharp.find(points, rows, poses, x, None)
        if warm_start.is_within(points):
            return warm_start.solved.pressed
        return self.sharp.find(points, rows, poses, x, self._dent(warm_start.solved))

    def _moved_on(self, points: CorotatedPoints, poses: Poses, solved: SolvedContact) -> PressedPoints | None:
        """The pressed points where the dent of a solved contact is, and not that of before it; None where they are
        the same, or there are none."""
        converged = solved.solution.converged
        if self.sharp is None or solved.pressed is None or not (converged and solved.is_pressed.any()):
            return None
        bearing = solved.is_pressed
        which = np.searchsorted(solved.pressed.index, solved.active[bearing])
        y = solved.deformed_position[solved.solution.active[bearing]]
        if not self.sharp.have_slid(solved.pressed, which, y, [poses[name] for name in self.searches]):
            return None
        x = points.bounded_positions(solved.rows)[0]
        return self.sharp.find(points, solved.rows, poses, x, self._dent(solved))

    def _dent(self, solved: SolvedContact) -> Dent:
        nodes, forces = self.node_forces(solved)
        return Dent(nodes, forces, self.of_nodes.farthest(nodes, forces) if len(nodes) else 0.0)
