"""The reduced simulator: backward Euler steps of a soft body among rigid colliders (thesis 5.4).

A control loop needs `Simulator.rest_state`, `Simulator.step`, and the result of a step; see
`examples/control_loop.py`. The cost of a step depends on handles, cubature cells and surface samples, never
on the size of the mesh; only `Simulator.positions` and `Simulator.deformation_gradients` touch every node or
cell. A step is a function of its arguments: warm starts and kept factorisations are in the state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.contact_force import ContactForce
from softprint.runtime.contact.lagged_friction import SlipStart
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.dynamics.body_checks import check_internal, check_kind, check_mechanics, check_state
from softprint.runtime.dynamics.corrected_nodes import CorrectedNodes, Corrections, Snapshot
from softprint.runtime.dynamics.deformed_surface import reduced_search
from softprint.runtime.dynamics.free_bodies import FreeBodies, FreeStep
from softprint.runtime.dynamics.free_body_contact import ColliderContact
from softprint.runtime.dynamics.hold import Hold
from softprint.runtime.dynamics.kinematic import KinematicHandle, place_kinematic
from softprint.runtime.dynamics.pierced_colliders import with_piercing
from softprint.runtime.dynamics.placed_collider import (
    PlacedCollider,
    check_colliders,
    free_colliders,
    poses_after,
    poses_at,
    starting_motions,
)
from softprint.runtime.dynamics.settings import DynamicsSettings
from softprint.runtime.dynamics.state import Configuration, ReducedState, StepResult
from softprint.runtime.dynamics.step.body_terms import build_terms, find_corrections
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.dynamics.step.frame import CorotatedFrame
from softprint.runtime.dynamics.step.held_hardening import solve_or_hold
from softprint.runtime.dynamics.step.static_solve import solve_static
from softprint.runtime.dynamics.step.step_energy import StepEnergy, StepPoint, by_axis
from softprint.runtime.dynamics.step.step_solve import SlidingStep, with_inner_solves_checked
from softprint.runtime.dynamics.step.step_start import kept_factorisation
from softprint.runtime.dynamics.terms.springs import HandleSpring, PointSpring, QuadraticForm
from softprint.runtime.dynamics.terms.weight import acceleration
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.optimise import Minimum, Newton, NewtonSettings, Status

# Forces of a strain below this count as balanced: the floor of the scale of residuals.
_NEGLIGIBLE_STRAIN = 1e-9
# The terms that cancel in the elastic energy near rest are as large as the stiffness: their round-off, of one cell.
_ROUND_OFF = 2e-16


class Simulator:
    """Steps one body.

    contact: the penalty law; gravity (dim,) [m/s^2]; kinematic: handles that are fixed or moved along a path and not
    solved for. Corrections belong to their colliders. mechanics: linear mechanics of the body outside the subspace:
    with its static condensation u the reduced positions are U rows + u everywhere, and with its surface compliance
    contact is condensed. internal: a learned correction of the body itself, on the subspace or on static condensation.
    Raises SoftprintError where body, mechanics, colliders, corrections, paths and handles do not
    fit together.
    """

    def __init__(
        self,
        body: ReducedBody,
        colliders: Sequence[PlacedCollider] = (),
        *,
        contact: PenaltyContact,
        mechanics: BodyMechanics | None = None,
        internal: InternalField | None = None,
        friction: CoulombFriction | None = None,
        gravity: Sequence[float] | Array | None = None,
        springs: Sequence[HandleSpring | PointSpring] = (),
        kinematic: Sequence[KinematicHandle] = (),
        settings: DynamicsSettings | None = None,
    ) -> None:
        self.body, self.colliders, self.contact = body, tuple(colliders), contact
        self.settings = settings or DynamicsSettings()
        self._gravity = acceleration(body, gravity)
        check_kind("contact", contact, PenaltyContact)
        check_kind("settings", self.settings, DynamicsSettings)
        for handle in kinematic:
            check_kind("a kinematic handle", handle, KinematicHandle)
        if friction is not None:
            check_kind("friction", friction, CoulombFriction)
        check_mechanics(body, mechanics)
        check_internal(internal, mechanics, self._gravity)
        check_colliders(self.colliders, body, mechanics, contact)
        self.mechanics = None if mechanics is None else mechanics.under(self._gravity)
        self.hold = Hold.of(body, springs, kinematic, self.settings.time_step)
        self._friction = friction if self.colliders else None
        self._corrections = find_corrections(body, self.colliders, self.mechanics, contact, internal)
        self._terms = build_terms(
            body, self.colliders, self._corrections, self.mechanics, contact, self._friction, self._gravity
        )
        stiffness = float(np.mean(body.material.young)) * body.mesh.size ** (body.dim - 1)
        weight = float(body.node_mass.sum() * np.linalg.norm(self._gravity))
        self._force_floor = max(_NEGLIGIBLE_STRAIN * stiffness, weight)
        self._energy_floor = _ROUND_OFF * float((body.material.young * body.mesh.cell_volumes).sum())
        shapes = {placed.name: placed.collider for placed in self.colliders}
        bodies = free_colliders(self.colliders)
        among = ColliderContact(bodies, shapes, contact, friction)
        surface = partial(np.matmul, body.basis[body.surface.nodes])
        self._free_bodies = FreeBodies(bodies, shapes, among, surface)
        self._pierced = reduced_search(body, shapes, self._corrections.contact, self._terms.surface)

    @property
    def pierced_from(self) -> float:
        """The depth [m] in the body from which on a collider has pierced it (`runtime/contact/piercing.py`)."""
        return self._pierced.depth

    @property
    def corrections(self) -> Corrections:
        """Those of the colliders."""
        return self._corrections

    def rest_state(self, time: float = 0.0, poses: Mapping[str, RigidPose] | None = None) -> ReducedState:
        """The undeformed body with zero velocity; kinematic handles at their positions at ``time`` [s]."""
        rest = self.body.rest_rows
        rows = place_kinematic(rest, rest, self.body.handles, self.hold.kinematic, time)
        where = poses_at(self.colliders, time, poses)
        return ReducedState(time, rows, np.zeros_like(rows), where, starting_motions(self.colliders))

    def step(
        self, state: ReducedState, poses: Mapping[str, RigidPose] | None = None
    ) -> StepResult[ReducedState]:
        """One time step. ``poses``: of colliders at the *end* of the step, instead of their paths."""
        check_state(state, self.body, self.colliders, self._corrections.contact)
        timings, h = Timings(), self.settings.time_step
        end = state.time + h
        end_poses = poses_after(self.colliders, end, poses, state.poses)
        free = self._free_bodies.step(state, h, self._gravity) if self._free_bodies else None
        inertia = QuadraticForm.about(self.body.reduced_mass / h**2, state.rows + h * state.rows_velocity)
        frame = self._terms.in_frame(state.rows, state.friction)
        begin = self._evaluated(frame, state, timings)
        limit = None if free is None else self._pierced.limit(begin, list(free.flights))
        problem = replace(self._problem(frame, inertia, end, free, timings), limit=limit)
        start, predicted_by = self.hold.start(state, problem, begin, end, end_poses)
        if free is not None:
            start = self._free_start(start, problem, begin, free, end_poses)
        point = problem.point(begin.near(start))
        if free is not None and limit is not None and not limit.allows(point.body):
            # From the state itself, where the free colliders are as deep as allowed.
            point = problem.point(
                begin.near(self.hold.start.at_rest(state, end, free.carried_on(end_poses, 0.0)))
            )
        solved = solve_or_hold(problem, point, begin, self.settings.method, self._sliding(state, timings))
        reached = self._reached(solved, end, (solved.x.body.at.rows - state.rows) / h, free)
        reached = replace(reached, factorisation=kept_factorisation(solved, predicted_by))
        result = self._result(solved, reached, inertia, timings, free)
        released = {name for name, contact in result.contacts.items() if not contact.points}
        drawn = solved.x.body.displaced(reached.friction)
        piercing = self._pierced.deepest(begin, drawn, released)
        if piercing is None:
            piercing = self._pierced.penetrating(result.contacts)
        if piercing is None and limit is not None and not solved.converged:
            piercing = limit.refused
        return with_piercing(result, piercing)

    def settle(
        self, state: ReducedState | None = None, newton: NewtonSettings | None = None
    ) -> StepResult[ReducedState]:
        """Static equilibrium near ``state`` (the rest state by default) at its time, without friction: the start of a
        scene. The body must be supported: by kinematic handles, springs or contact. Colliders that move freely keep
        their poses and motions. The status is MAX_ITERATIONS also where forces balance in a corotated frame that is not
        yet that of the result (`step/static_solve.py`)."""
        begin = state or self.rest_state()
        check_state(begin, self.body, self.colliders, self._corrections.contact)
        optimiser = Newton(newton or NewtonSettings(max_iterations=100, tolerance=1e-6))
        timings = Timings()
        solved = solve_static(begin, lambda at: self._static(at, timings), self._rotations, optimiser)
        return self._static_result(solved, begin, timings)

    def at_rest(self) -> StepResult[ReducedState]:
        """The rest state as a result without any step: its energies and contact forces."""
        state, timings = self.rest_state(), Timings()
        _, point = self._static(state, timings)
        return self._static_result(Minimum(point, Status.CONVERGED, 0, 0.0, 0.0), state, timings)

    def _evaluated(self, frame: CorotatedFrame, state: ReducedState, timings: Timings) -> BodyEvaluation:
        """The body at a state in a frame, with the warm start and the kept Hessian of the state."""
        contact = self._corrections.contact
        warm_start = None if contact is None else contact.resume(state.contact)
        at = Configuration(state.rows, state.poses)
        return BodyEvaluation(frame, at, warm_start, state.elastic_hessian, timings)

    def _free_start(
        self, start: Configuration, problem: StepEnergy, begin: BodyEvaluation, free: FreeStep, poses: Poses
    ) -> Configuration:
        """The starting point with the free colliders moved by their momenta until they meet an obstacle."""
        body = begin

        def energy(at: Configuration) -> float:
            nonlocal body
            point = problem.point(body.near(at))
            body = point.body
            return problem.energy(point)

        return free.start(start.rows, poses, energy)

    def _sliding(self, state: ReducedState, timings: Timings) -> SlidingStep | None:
        """The start from which the slip of a step is measured; None without friction."""
        if self._friction is None:
            return None
        body = self._evaluated(self._terms.in_frame(state.frame), state, timings)
        h = self.settings.time_step

        def contact_points(index: IntArray, of: ContactEvaluation) -> Array:
            found = self._contact_at(state, body)
            assert found is not None  # called by condensed contact only
            return found.deformed_positions(index, of, state.friction)

        slip = SlipStart(body.positions, state.poses, h, contact_points, lambda: body.surface.sharp.x)
        return SlidingStep(slip, self.settings.friction_updates, state.friction)

    def _contact_at(self, state: ReducedState, body: BodyEvaluation) -> ContactEvaluation | None:
        """The condensed contact of a state: the stored one if it was solved at the rows of the state."""
        contact, points = self._corrections.contact, body.frame.contact_points
        if contact is None or points is None:
            return None
        return (
            contact.evaluation(points, state.rows, state.contact) if state.contact_is_here else body.contact
        )

    def _static(self, state: ReducedState, timings: Timings) -> tuple[StepEnergy, StepPoint]:
        """The energy without inertia in the frame of a state, and its point at that state."""
        frame = self._terms.in_frame(state.rows)
        problem = self._problem(frame, self._no_inertia, state.time, None, timings)
        return problem, problem.point(self._evaluated(frame, state, timings))

    def _static_result(
        self, solved: Minimum[StepPoint], begin: ReducedState, timings: Timings
    ) -> StepResult[ReducedState]:
        state = self._reached(solved, begin.time, np.zeros_like(begin.rows), None)
        state = replace(state, motions=begin.motions)
        result = self._result(solved, state, self._no_inertia, timings, None)
        body = solved.x.body
        return with_piercing(result, self._pierced.deepest(body, body, ()))

    @cached_property
    def _no_inertia(self) -> QuadraticForm:
        return QuadraticForm.about(np.zeros_like(self.body.reduced_mass), self.body.rest_rows)

    def _rotations(self, rows: Array) -> Array:
        """(n, dim, dim) of the nodes of the body; none without static condensation."""
        condensation = None if self.mechanics is None else self.mechanics.condensation
        if condensation is None:
            return np.empty((0, self.body.dim, self.body.dim))
        return condensation.corotation.rotations(rows)

    def _problem(
        self,
        frame: CorotatedFrame,
        inertia: QuadraticForm,
        time: float,
        free: FreeStep | None,
        timings: Timings,
    ) -> StepEnergy:
        springs = self.hold.springs.form(time)
        weight, height = frame.weight
        quadratic = QuadraticForm(
            inertia.matrix + springs.matrix,
            inertia.linear + springs.linear + weight,
            inertia.constant + springs.constant + height,
        )
        blocks = by_axis(quadratic.matrix, self.body.dim)
        floors = self._force_floor, self._energy_floor
        return StepEnergy(self.hold.unknowns, quadratic, springs, blocks, free, None, *floors, timings)

    def _reached(
        self, solved: Minimum[StepPoint], time: float, velocity: Array, free: FreeStep | None
    ) -> ReducedState:
        """The state at the end of a solve, with the warm start of the next one."""
        body = solved.x.body
        return ReducedState(
            time=time,
            rows=body.at.rows,
            rows_velocity=velocity,
            poses=body.at.poses,
            motions={} if free is None else free.motions(body.at.poses),
            friction=solved.x.friction_on_nodes,
            frame_rows=body.frame.rows,
            contact=_solved_contact(body),
            elastic_hessian=body.kept_hessian,
        )

    def _result(
        self,
        solved: Minimum[StepPoint],
        state: ReducedState,
        inertia: QuadraticForm,
        timings: Timings,
        free: FreeStep | None,
    ) -> StepResult[ReducedState]:
        solved = with_inner_solves_checked(solved)
        x, rows, velocity = solved.x, state.rows, state.rows_velocity
        normal, friction, forces = x.contacts()
        weight, height = x.body.frame.weight
        energies = {
            "inertia": inertia.energy(rows),
            "kinetic": 0.5 * float(np.vdot(velocity, self.body.reduced_mass @ velocity)),
            "gravity": height - float(np.vdot(weight, rows)) + x.body.correction_height,
            "springs": x.problem.springs.energy(rows),
            "elastic": x.body.elastic.energy,
            "contact": normal,
            "friction": friction,
        }
        if self._free_bodies:
            energies["inertia"] += 0.0 if free is None else free.inertia(state.poses)
            energies["kinetic"] += self._free_bodies.kinetic(state.poses, state.motions)
            energies["gravity"] += self._free_bodies.weight(state.poses, self._gravity)
        return StepResult(
            state,
            solved.status,
            solved.reason,
            solved.iterations,
            solved.residual,
            energies,
            timings.seconds(),
            forces,
        )

    def surface_positions(self, state: ReducedState) -> Array:
        """(s, dim) [m]: the surface samples of the body, corrections included, at a cost that does not grow with the
        mesh."""
        return self.surface_drawn(self.surface_snapshot(state))

    def surface_snapshot(self, state: ReducedState) -> Snapshot:
        """A snapshot from which `surface_drawn` computes the same positions later."""
        return self._snapshot(state, self._samples)

    def surface_drawn(self, snapshot: Snapshot) -> Array:
        """(s, dim) [m] of a snapshot. May run on any thread or in another process, concurrently with the next step
        (`runtime/scenes/background_drawing.py`)."""
        return self._samples.positions(snapshot)

    def follow(self, nodes: IntArray) -> Callable[[ReducedState], Array]:
        """Positions (n, dim) [m] of some nodes (n,) of the mesh as a function of the state, corrections included:
        prepared once, at a cost that does not grow with the mesh."""
        followed = self._corrected_nodes(nodes)
        return lambda state: followed.positions(self._snapshot(state, followed))

    def positions(self, state: ReducedState) -> Array:
        """(n_nodes, dim) [m]: every node of the mesh, corrections included. The cost is proportional to the mesh."""
        return self._nodes.positions(self._snapshot(state, self._nodes))

    def _snapshot(self, state: ReducedState, nodes: CorrectedNodes) -> Snapshot:
        """Of a state, for some nodes."""
        solved = state.contact
        if not state.contact_is_here:
            frame = self._terms.in_frame(state.frame, state.friction)
            solved = _solved_contact(self._evaluated(frame, state, Timings()))
        field = nodes.field_displacement(state.rows, state.poses)
        return Snapshot(state.rows, state.frame, solved, state.friction, field)

    @cached_property
    def _nodes(self) -> CorrectedNodes:
        return self._corrected_nodes(None)

    @cached_property
    def _samples(self) -> CorrectedNodes:
        return self._corrected_nodes(self.body.surface.nodes)

    def _corrected_nodes(self, nodes: IntArray | None) -> CorrectedNodes:
        condensation = None if self.mechanics is None else self.mechanics.condensation
        if condensation is not None and nodes is not None:
            condensation = condensation.at(nodes)
        return CorrectedNodes(self.body, self._corrections, condensation, nodes)

    def contact_forces(self, state: ReducedState) -> dict[str, ContactForce]:
        """The normal forces on every collider at a state; those of a `StepResult` include friction."""
        frame = self._terms.in_frame(state.frame, state.friction)
        body = self._evaluated(frame, state, Timings())
        contact = self._contact_at(state, body)
        forces = {**body.surface.forces(None), **({} if contact is None else contact.forces())}
        return forces if body.frames is None else body.frames.added_to(forces)

    def deformation_gradients(self, state: ReducedState, cells: IntArray | None = None) -> Array:
        """(n, dim, dim) F of the given cells of the mesh (all by default), corrections included."""
        return self.body.mesh.deformation_gradients(
            self.positions(state), slice(None) if cells is None else cells
        )


def _solved_contact(body: BodyEvaluation) -> SolvedContact | None:
    """The warm start of the next contact solve."""
    return None if body.contact is None else body.contact.solved
