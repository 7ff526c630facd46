"""The contact of a reduced state as mechanics alone gives it, and how it changes with the state.

Loads near the collider are pressed by `contact_solve.py` at their positions x(q), internal response included. Let f
= p g be the forces in balance, D their stiffening, G the compliance at rest and G_w = F G F^T the same carried
along. With dxi = dx + dF v the motion of a load that keeps its displacement v in rest coordinates, and dphi = dF^T f,

    (I + G_w D) dy = dxi + F G dphi =: c,    df = -D dy.

So the energy W(q) of contact and dent together has (Clapeyron's theorem, envelope theorem)

    dW = -sum_j f_j . dxi_j,    d2W = c^T D (I + G_w D)^-1 c - dphi^T G dphi,

both exact: no derivative beyond the Hessian of the distance is needed, for x and F are affine in the handle rows while
the body's turn is held.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from runtime.arrays import Array, BoolArray, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.contact.condensed import contact_node_kernels, contact_solve_kernels
from runtime.contact.condensed.candidates import ActiveSet, Candidates, ColliderDistance, NodeDistance
from runtime.contact.condensed.contact_nodes import ContactNodes
from runtime.contact.condensed.contact_solve import ContactProblem, ContactSolution
from runtime.contact.condensed.press_memory import PressMemory
from runtime.contact.condensed.warm_start import warm_start
from runtime.contact.condensed.woodbury import WoodburyFactor
from runtime.linalg.row_products import placed
from runtime.linalg.sparse_directions import times_directions
from runtime.mechanics.body_mechanics import BodyMechanics
from runtime.mechanics.local_compliance import LocalCompliance
from runtime.mechanics.position_bounds import PositionBounds

# Loads outside the collider by up to this share of its depth could be pushed into it by the dent beside them. Farther
# out few are, one in fifty of those that bear pressure under thin and curved colliders; they are found by looking.
_ROOM = 0.25
# Loads are looked for within so many times the distance that was needed last.
_MORE = 1.2
# The loads that were pushed in push others in turn: so often it is looked again.
_LOOKS = 3


# Positions of all loads (n, dim) [m], and how far they may be from there (n,) [m].
Surroundings = tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class ContactEquilibrium:
    """rows, turn, pose: of the state of these loads; around: those within the band around the collider or held by it,
    undisplaced at around_position (.., dim) [m]; index: (m,) those of them that could bear pressure, the problem of
    these and its solution; k of them do bear pressure."""

    loads: ContactNodes
    rows: Array
    turn: Array
    pose: RigidPose
    around: IntArray
    around_position: Array
    index: IntArray
    problem: ContactProblem
    solution: ContactSolution

    def predict(
        self, index: IntArray, problem: ContactProblem, pose: RigidPose
    ) -> tuple[Array, Array] | None:
        """Where to start from with the loads `index` at a state nearby, see `warm_start.py`."""
        y = self.gone_to
        follows = pose.apply(self.pose.apply_inverse(y)) - y
        return warm_start(self, index, problem, follows, pose.rotation @ self.pose.rotation.T)

    @property
    def displaced(self) -> Array:
        """y (k, dim) [m] of the loads that bear pressure."""
        return self.gone_to[self.bearing]

    @cached_property
    def gone_to(self) -> Array:
        """y (m, dim) [m] of all of them."""
        return np.asarray(self.problem.position + self.solution.moved)

    @cached_property
    def pressed(self) -> IntArray:
        """(k,) the loads that bear pressure."""
        return self.index[self.bearing]

    @cached_property
    def held(self) -> ActiveSet:
        """The same, as the next state may find them."""
        b, solution = self.bearing, self.solution
        return ActiveSet(self.pressed, self.problem.F[b], solution.normal[b], solution.farthest)

    @property
    def bearing(self) -> IntArray:
        """(k,) which of the m bear pressure."""
        return self.solution.bearing

    @property
    def load(self) -> Array:
        """F^T f (k, dim) [N] of those that do."""
        b, solution = self.bearing, self.solution
        return contact_solve_kernels.pulled_back(self.problem.F[b], solution.pressure[b], solution.normal[b])

    @property
    def gradient(self) -> Array:
        """dW/drows (n_rows, dim) [N]."""
        b, solution = self.bearing, self.solution
        return -self.loads.felt(self.turn, self.pressed, solution.force[b], solution.given[b])

    def second_derivative(self, along: Array | None = None) -> Array:
        """d2W/drows2 (R, R) [N/m]; along: see `RowHessian`."""
        kind = self.problem.compliance.dtype
        carried, turned = (motion.astype(kind, copy=False) for motion in self._carried_along)
        if along is not None:
            carried, turned = times_directions(carried, along), times_directions(turned, along)
        answer = self.factor.given(turned)
        curvature = self.factor.curvature(carried + self.factor.carried(answer)) - turned.T @ answer
        return np.asarray(curvature, dtype=np.float64)

    @cached_property
    def factor(self) -> WoodburyFactor:
        """Solved with for rows, twists and predictions."""
        return WoodburyFactor(self.problem, self.solution)

    @cached_property
    def answer(self) -> Array:
        """G dphi (k*dim, R), to the handle rows."""
        return self.factor.given(self.turned)

    @cached_property
    def stiffened(self) -> Array:
        """D (I + G_w D)^-1 c (k*dim, R) of the handle rows."""
        return self.factor.stiffen(self.carried + self.factor.carried(self.answer))

    @property
    def carried(self) -> Array:
        """dx + dF v (k*dim, R) of the loads that bear pressure: how they move with their displacement v held."""
        return self._carried_along[0]

    @property
    def turned(self) -> Array:
        """dphi = dF^T f (k*dim, R), how their loads turn with their forces held."""
        return self._carried_along[1]

    @cached_property
    def _carried_along(self) -> tuple[Array, Array]:
        b, solution = self.bearing, self.solution
        motion = self.loads.motion(self.turn, self.pressed)
        return contact_node_kernels.carried_along(
            solution.given[b], solution.force[b], motion.position, motion.basis_gradient
        )


class LoadProbe:
    """Presses the loads of one body against one collider. stiffness: of the penalty contact [N/m^4]; band: [m], of
    loads around the collider that others ask for."""

    def __init__(
        self,
        body: ReducedBody,
        collider: Collider,
        mechanics: BodyMechanics,
        stiffness: float,
        band: float = 0.0,
    ) -> None:
        compliance, internal = mechanics
        points = body.node_points(compliance.nodes)
        self.collider, self.nodes = collider, compliance.nodes
        self.among_loads = compliance.among_loads()
        self.points = points
        self.internal = None if internal is None else internal.at(compliance.nodes)
        self.loads = ContactNodes(points, self.internal)
        self._stiffness, self._band = stiffness * compliance.areas, band
        self._reach = (
            None if self.internal is None else PositionBounds(points.basis, self.internal, body.handles)
        )
        self._bounded = bool(np.isfinite(collider.upper).all())
        self._room = 0.0  # within which loads were looked for last [m]
        self._no_reach = np.zeros(len(compliance.nodes))
        self._among_near = LocalCompliance(self.among_loads)
        self._memory = PressMemory[RigidPose, ContactEquilibrium](lambda last, pose: last is pose)

    def unlike(self, other: LoadProbe) -> bool:
        """Whether it presses otherwise than another on the same compliance."""
        alike = np.array_equal(self._stiffness, other._stiffness) and self._band == other._band
        return not alike or self.internal is not other.internal

    def _near(
        self, rows: Array, pose: RigidPose, turn: Array, distance: float, about: Surroundings
    ) -> tuple[IntArray, Array, Array]:
        """The loads closer to the collider than `distance` [m], their signed distance and position (m, dim) [m]. Where
        they are exactly is asked only of loads that could be there."""
        x, reach = about
        if self._bounded:
            bounds = self.collider.lower - distance, self.collider.upper + distance
            candidates = contact_node_kernels.within(x, pose.rotation, pose.translation, *bounds, reach)
        else:  # a half-space, whose bounds exclude nothing
            candidates = np.flatnonzero(self.collider.sdf(pose.apply_inverse(x)) < distance + reach)
        x = x[candidates] if self.internal is None else self.loads.positions(rows, turn, candidates)
        close, _, value = self.collider.closer_to(x, pose, distance)
        return candidates[close], value, x[close]

    def surroundings(self, rows: Array, turn: Array) -> Surroundings:
        """Of all loads."""
        if self._reach is None:
            return placed(self.points.basis, rows), self._no_reach
        return self._reach(rows, turn)

    def press(self, rows: Array, pose: RigidPose, turn: Array) -> ContactEquilibrium | None:
        """The loads in balance at handle rows (n_rows, dim), or None where none is inside the collider."""
        return self._memory.press(rows, pose, turn, partial(self._press, rows, pose, turn))

    def begin(self) -> None:
        """Forget what was pressed before, and start from nothing."""
        self._memory.forget()

    def hold(self, press: ContactEquilibrium | None) -> None:
        """See `PressMemory`."""
        self._memory.hold(press)

    def _press(
        self, rows: Array, pose: RigidPose, turn: Array, near: ContactEquilibrium | None
    ) -> ContactEquilibrium | None:
        around = self.around(rows, pose, turn, held=None if near is None else near.held)
        if around is None:
            return None
        index = around.index[around.could_bear]
        distance = ColliderDistance(self.collider, pose)
        problem = self.problem(rows, around, distance)
        start = None if near is None else near.predict(index, problem, pose)
        if near is not None and start is None:  # what is held so far away says nothing of here
            return self._press(rows, pose, turn, None)
        press = self.balanced(rows, pose, turn, around, distance, problem, start)
        return press if press.bearing.size or around.reaches_in else None

    def balanced(
        self,
        rows: Array,
        pose: RigidPose,
        turn: Array,
        around: Candidates,
        distance: NodeDistance,
        problem: ContactProblem,
        start: tuple[Array, Array] | None = None,
    ) -> ContactEquilibrium:
        """Loads (n,) around in balance, those that the dent pushes in included; distance: at all of them; problem: of
        those that could bear pressure; start: see `ContactProblem.solve`, of these."""
        solution = problem.solve(start)
        for _ in range(_LOOKS):
            pushed = self._pushed_in(rows, around, problem, solution, distance)
            if not pushed.any():
                break
            before, around = around.could_bear, around.with_bearing(pushed)
            problem = self.problem(rows, around, distance)
            solution = problem.solve(solution.joined_by(before[around.could_bear]))
        index = around.index[around.could_bear]
        state = rows.copy(), turn.copy(), pose
        return ContactEquilibrium(self.loads, *state, around.index, around.position, index, problem, solution)

    def _pushed_in(
        self,
        rows: Array,
        around: Candidates,
        problem: ContactProblem,
        solution: ContactSolution,
        distance: NodeDistance,
    ) -> BoolArray:
        """(n,) which of the loads around, not among those that could bear pressure, the dent pushes into the
        collider."""
        b, pushed = solution.bearing, np.zeros(len(around.index), dtype=bool)
        # Nothing beside the loads that are pressed is moved farther than they are.
        beside = ~around.could_bear & (around.distance < solution.farthest)
        if not beside.any():
            return pushed
        index, bearing = around.index[beside], around.index[around.could_bear][b]
        load = contact_solve_kernels.pulled_back(problem.F[b], solution.pressure[b], solution.normal[b])
        v = self._among_near.displacement(index, bearing, load)
        moved = contact_solve_kernels.moved_by(self.loads.deformation(rows, index), v)
        pushed[beside] = distance.among(beside).value(around.position[beside] + moved) < 0.0
        return pushed

    def around(
        self,
        rows: Array,
        pose: RigidPose,
        turn: Array,
        about: Surroundings | None = None,
        held: ActiveSet | None = None,
    ) -> Candidates | None:
        """The loads about the collider; None where none is inside. about: `surroundings`, where they are known; held:
        by the collider in a state nearby. What it pushes in may bear pressure wherever it is undisplaced, for it does
        not let go what has gone through a thin wall."""
        about = about or self.surroundings(rows, turn)
        looked = max(self._band, self._room)
        index, distance, x = self._near(rows, pose, turn, looked, about)
        depth = max(-float(distance.min(initial=0.0)), 0.0)
        wanted = max(self._band, _ROOM * depth)
        if wanted > looked:
            index, distance, x = self._near(rows, pose, turn, wanted, about)
        elif wanted < looked:
            near = distance < wanted
            index, distance, x = index[near], distance[near], x[near]
        # As a rule the next state is pressed as deep.
        self._room = _MORE * _ROOM * depth
        around = Candidates(index, distance, x, depth, distance < _ROOM * depth)
        if held is not None:
            around = self._holding(around, held, rows, turn)
        return around if around.depth > 0.0 else None

    def _holding(self, around: Candidates, held: ActiveSet, rows: Array, turn: Array) -> Candidates:
        """With the loads held, of no depth where neither any is inside nor any pushed in."""
        if around.depth == 0.0 and not held.pushed_in(self.points.surface_normal).any():
            return around
        around = replace(around, depth=max(around.depth, held.moved))
        around = around.with_bearing(contact_node_kernels.are_among(around.index, held.index))
        there = contact_node_kernels.are_among(held.index, around.index)
        if there.all():
            return around
        lost = held.take(~there)
        kept = lost.index[lost.pushed_in(self.points.surface_normal)]
        return around.joined_by(kept, self.loads.positions(rows, turn, kept)) if kept.size else around

    def problem(self, rows: Array, around: Candidates, distance: NodeDistance) -> ContactProblem:
        """Of the loads that could bear pressure; distance: of all around."""
        index = around.index[around.could_bear]
        return ContactProblem(
            self._among_near.compliance(index),
            self.loads.deformation(rows, index),
            self._stiffness[index],
            around.position[around.could_bear],
            around.depth,
            distance.among(around.could_bear),
        )

    def settled(self, rows: Array, pose: RigidPose, turn: Array) -> Callable[[IntArray], Array]:
        """y = x + F v (m, dim) [m] of any loads (m,) at handle rows (n_rows, dim)."""
        return self.settled_by(self.press(rows, pose, turn), rows, turn)

    def settled_by(
        self, press: ContactEquilibrium | None, rows: Array, turn: Array
    ) -> Callable[[IntArray], Array]:
        """The same in the dent of a press; None: in none."""
        if press is None:
            return self.loads.positions(rows, turn).__getitem__

        def positions(index: IntArray) -> Array:
            moved = self.moved_by(press.pressed, press.load, index, self.loads.deformation(rows, index))
            return np.asarray(self.loads.positions(press.rows, turn, index) + moved)

        return positions

    def moved_by(self, pressed: IntArray, load: Array, index: IntArray, F: Array) -> Array:
        """F v (m, dim) [m] of any loads (m,) where loads phi (k, dim) [N] are pressed; F: (m, dim, dim)."""
        return contact_solve_kernels.moved_by(F, self._among_near.displacement(index, pressed, load))
