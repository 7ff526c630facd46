"""The reduced simulator: backward Euler steps of a soft body among rigid colliders (thesis 5.4).

A control loop needs `Simulator.rest_state`, `Simulator.step`, and what a step returns; see
`examples/control_loop.py`. The cost of a step depends on handles, cubature cells and surface samples, never
on the size of the mesh; only `Simulator.positions` and `Simulator.deformation_gradients` touch every node or
cell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from runtime.arrays import Array, IntArray, same
from runtime.body.body import ReducedBody
from runtime.colliders.pose import RigidPose
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.contact.condensed.condensed_contact import CondensedContact
from runtime.contact.contact_force import ContactForce
from runtime.contact.friction_state import FrictionState
from runtime.dynamics.corrected_nodes import CorrectedNodes, Snapshot
from runtime.dynamics.corrected_points import CorrectedPoints
from runtime.dynamics.free_bodies import FreeBodies, FreeStep
from runtime.dynamics.free_body_contact import ColliderContact
from runtime.dynamics.kinematic import KinematicHandle, free_dofs, place_kinematic
from runtime.dynamics.newton import NewtonResult, NewtonSettings, Status, minimise
from runtime.dynamics.placed_collider import (
    PlacedCollider,
    check_colliders,
    free_colliders,
    poses_after,
    poses_at,
    starting_motions,
)
from runtime.dynamics.state import Configuration, ReducedState, StepResult
from runtime.dynamics.step_energy import StepEnergy
from runtime.dynamics.step_start import StepStart
from runtime.dynamics.terms.condensed_elastic import CondensedElasticEnergy
from runtime.dynamics.terms.elastic import Elastic, ElasticEnergy
from runtime.dynamics.terms.kept_elastic_hessian import kept_if_dear
from runtime.dynamics.terms.springs import HandleSpring, QuadraticForm, Springs
from runtime.dynamics.terms.surface_contact import SurfaceContactEnergy
from runtime.dynamics.terms.weight import Weight
from runtime.dynamics.timings import Timings
from runtime.elasticity.reduced_elasticity import ReducedElasticity
from runtime.errors import SoftprintError
from runtime.learned.correction import is_field
from runtime.mechanics.static_condensation import StaticCondensation

# A body strained by less than this feels no force worth balancing: the floor of the scale of residuals.
_NEGLIGIBLE_STRAIN = 1e-9
# A surface point whose reduced position is farther from the collider than this share of the collider's size
# is taken not to be pushed into it by a correction, and so needs none.
_REACH = 0.25
# A static solve turns the internal response anew until no part of it turns by more than this [rad], but not more often
# than so many times: it converges fast, for the turn hardly matters where strain is small.
_SAME_TURN = 1e-6
_TURNS = 10


@dataclass(frozen=True)
class DynamicsSettings:
    """time_step h [s]; newton: for each step; friction_updates: how many of a step's first Newton iterations
    take up new normal forces for friction, which are then frozen so that the iterations can converge."""

    time_step: float = 1.0 / 60.0
    newton: NewtonSettings = field(default_factory=NewtonSettings)
    friction_updates: int = 3

    def __post_init__(self) -> None:
        if not (np.isfinite(self.time_step) and self.time_step > 0):
            raise SoftprintError(f"the time step must be a positive number of seconds, not {self.time_step}")
        if self.friction_updates < 1:
            raise SoftprintError(f"friction_updates must be at least 1, not {self.friction_updates}")


class Simulator:
    """Steps one body.

    gravity (dim,) [m/s^2]; kinematic: handles that are held or led and not solved for. Corrections come with
    their colliders. internal: how the body settles where the subspace cannot follow, for all of its nodes and
    the same gravity; with it the reduced positions are U rows + u_int everywhere; that which a correction brings by
    default. Raises SoftprintError where body, colliders, paths and handles do not fit together.
    """

    def __init__(
        self,
        body: ReducedBody,
        colliders: Sequence[PlacedCollider] = (),
        *,
        contact: PenaltyContact,
        friction: CoulombFriction | None = None,
        gravity: Sequence[float] | Array | None = None,
        springs: Sequence[HandleSpring] = (),
        kinematic: Sequence[KinematicHandle] = (),
        settings: DynamicsSettings | None = None,
        internal: StaticCondensation | None = None,
    ) -> None:
        self.body = body
        self.colliders = tuple(colliders)
        self.settings = settings or DynamicsSettings()
        self._springs = Springs(springs, body.handles)
        self._springs_at: tuple[float, QuadraticForm] | None = None
        self._kinematic = tuple(kinematic)
        if internal is None:
            brought = (
                placed.correction.internal for placed in self.colliders if placed.correction is not None
            )
            internal = next((response for response in brought if response is not None), None)
        self._internal = internal
        acceleration = np.zeros(body.dim) if gravity is None else np.asarray(gravity, dtype=float)
        self._check(acceleration)
        self._gravity = acceleration
        self._start = StepStart(body, self._kinematic, self.settings.time_step)
        self._free = free_dofs(body.handles, self._kinematic)
        self._weight = Weight(body, acceleration, internal)
        self._units = body.handles.units(0.5 * body.mesh.size)[self._free]
        stiffness = float(np.mean(body.material.young)) * body.mesh.size ** (body.dim - 1)
        self._force_floor = max(
            _NEGLIGIBLE_STRAIN * stiffness, float(body.node_mass.sum() * np.linalg.norm(acceleration))
        )
        shapes = {placed.name: placed.collider for placed in self.colliders}
        self._corrections = [(p.name, p.correction) for p in self.colliders if p.correction is not None]
        potentials = {
            name: correction.potential
            for name, correction in self._corrections
            if correction.potential is not None
        }
        self._condensed = CondensedContact(potentials, friction)
        at_points = [(name, correction) for name, correction in self._corrections if is_field(correction)]
        penalised = {name: shape for name, shape in shapes.items() if name not in potentials}
        sizes = [shapes[name].size for name, _ in at_points if np.isfinite(shapes[name].size)]
        self._points = CorrectedPoints(body, at_points, _REACH * max(sizes, default=np.inf))
        elastic: Elastic = (
            ElasticEnergy(body, self._points)
            if internal is None
            else CondensedElasticEnergy(body, self._points, internal)
        )
        self._elastic = kept_if_dear(elastic, ReducedElasticity.of(body))
        self._surface = SurfaceContactEnergy(body, self._points, penalised, contact, friction, internal)
        self._nodes = CorrectedNodes(body, self._corrections, internal, joint=self._condensed.joint)
        self._samples = CorrectedNodes(
            body, self._corrections, internal, body.surface.nodes, self._condensed.joint
        )
        self._friction = friction
        free = free_colliders(self.colliders)
        self._movers = FreeBodies(
            free, shapes, ColliderContact(free, shapes, contact, friction), body.basis[body.surface.nodes]
        )
        self._last: tuple[ReducedState, Array, Array] | None = None  # the surface at the end of the last step

    def _check(self, gravity: Array) -> None:
        dim = self.body.dim
        if gravity.shape != (dim,) or not np.isfinite(gravity).all():
            raise SoftprintError(f"gravity must be {dim} numbers for this body, not {gravity.tolist()}")
        if self._internal is not None:
            if len(self._internal) != self.body.n_nodes:
                raise SoftprintError(
                    f"the internal response is of {len(self._internal)} nodes, but the body has {self.body.n_nodes}: "
                    "give that of all of them"
                )
            if not np.allclose(self._internal.gravity, gravity, rtol=1e-12):
                raise SoftprintError(
                    f"the internal response is for the gravity {self._internal.gravity.tolist()}, not for "
                    f"{gravity.tolist()}: train the correction for the gravity of the scene, or take "
                    "`StaticCondensation.under` it"
                )
        check_colliders(self.colliders, dim)

    def rest_state(self, time: float = 0.0, poses: Mapping[str, RigidPose] | None = None) -> ReducedState:
        """The undeformed body, not moving; kinematic handles where they are at ``time`` [s]. A motion begins: where
        contact came from is forgotten, of which drawings and forces of a state in contact may depend."""
        self._condensed.begin()
        rest = self.body.rest_rows
        rows = place_kinematic(rest, rest, self.body.handles, self._kinematic, time)
        where = poses_at(self.colliders, time, poses)
        return ReducedState(time, rows, np.zeros_like(rows), where, motions=starting_motions(self.colliders))

    def step(
        self, state: ReducedState, poses: Mapping[str, RigidPose] | None = None
    ) -> StepResult[ReducedState]:
        """One time step. ``poses``: of colliders at the *end* of the step, in place of their paths."""
        self._check_state(state)
        timings = Timings()
        h = self.settings.time_step
        end = state.time + h
        end_poses = poses_after(self.colliders, end, poses, state.poses)
        free = (
            self._movers.step(state, h, self._gravity, self._friction is not None) if self._movers else None
        )
        inertia = QuadraticForm.about(self.body.reduced_mass / h**2, state.rows + h * state.rows_velocity)
        turn = state.rows
        contact = None
        if self._friction is not None:
            before = turn if state.turn is None else state.turn
            surface = self._surface_of(state, before, timings)
            with timings.contact:
                settled = self._condensed.settled(state.rows, state.poses, before)
            contact = FrictionState(surface, state.poses, h, settled)
        energy = self._energy(end, turn, inertia, contact, timings, free)
        begin = self._start(state, energy, end, end_poses)
        if free is not None:
            begin = free.start(begin.rows, end_poses, energy.energy)
        solved = minimise(energy, begin, self.settings.newton, timings.solve)
        rows, end_poses = solved.x
        velocity = (rows - state.rows) / h
        motions = {} if free is None else free.motions(end_poses)
        reached = ReducedState(end, rows, velocity, end_poses, turn, motions)
        self._start.learn(solved, reached, energy)
        return self._result(solved, reached, energy, inertia, timings, free)

    def _check_state(self, state: ReducedState) -> None:
        """One that the last step did not return may have been made by hand."""
        if self._last is None or self._last[0] is not state:
            self.body.handles.check_rows(state.rows, "rows of the state")

    def settle(
        self, state: ReducedState | None = None, newton: NewtonSettings | None = None
    ) -> StepResult[ReducedState]:
        """Static equilibrium near ``state`` (the rest state by default) at its time, without friction: where
        a scene starts. Something must hold the body: kinematic handles, springs or contact. Colliders that move freely
        stay where they are, and keep their motion."""
        begin = state or self.rest_state()
        self._check_state(begin)
        settings = newton or NewtonSettings(max_iterations=100, tolerance=1e-6)
        timings = Timings()
        rows, iterations = begin.rows, 0
        for _ in range(_TURNS):
            energy = self._static_energy(begin, rows, timings)
            turned = self._turns(rows)
            solved = minimise(energy, Configuration(rows, begin.poses), settings, timings.solve)
            rows, iterations = solved.x.rows, iterations + solved.iterations
            if not solved.converged or np.abs(self._turns(rows) - turned).max(initial=0.0) < _SAME_TURN:
                break
        return self._static_result(replace(solved, iterations=iterations), begin, energy, timings)

    def at_rest(self) -> StepResult[ReducedState]:
        """The rest state as the result of no step at all: its energies and contact forces."""
        state, timings = self.rest_state(), Timings()
        solved = NewtonResult(Configuration(state.rows, state.poses), Status.CONVERGED, 0, 0.0, 0.0)
        energy = self._static_energy(state, state.rows, timings)
        return self._static_result(solved, state, energy, timings)

    def _turns(self, turn: Array) -> Array:
        """(n, dim, dim), see `StaticCondensation.turns`; none where there is no such response."""
        return (
            np.empty((0, self.body.dim, self.body.dim))
            if self._internal is None
            else self._internal.turns(turn)
        )

    def _pulled(self, time: float) -> QuadraticForm:
        """By the springs, at a time [s]; that of the last one asked for is kept."""
        if self._springs_at is None or self._springs_at[0] != time:
            self._springs_at = time, self._springs.form(time)
        return self._springs_at[1]

    def _static_energy(self, state: ReducedState, turn: Array, timings: Timings) -> StepEnergy:
        return self._energy(state.time, turn, self._no_inertia, None, timings, None)

    def _static_result(
        self, solved: NewtonResult[Configuration], begin: ReducedState, energy: StepEnergy, timings: Timings
    ) -> StepResult[ReducedState]:
        rows = solved.x.rows
        state = ReducedState(begin.time, rows, np.zeros_like(rows), begin.poses, energy.turn, begin.motions)
        return self._result(solved, state, energy, self._no_inertia, timings, None)

    @cached_property
    def _no_inertia(self) -> QuadraticForm:
        return QuadraticForm.about(np.zeros_like(self.body.reduced_mass), self.body.rest_rows)

    def _energy(
        self,
        time: float,
        turn: Array,
        inertia: QuadraticForm,
        contact: FrictionState | None,
        timings: Timings,
        free: FreeStep | None,
    ) -> StepEnergy:
        springs = self._pulled(time)
        weight, height = self._weight.form(turn)
        quadratic = QuadraticForm(
            inertia.matrix + springs.matrix,
            inertia.linear + springs.linear + weight,
            inertia.constant + springs.constant + height,
        )
        return StepEnergy(
            handles=self.body.handles,
            free=self._free,
            quadratic=quadratic,
            points=self._points,
            elastic=self._elastic,
            surface=self._surface,
            condensed=self._condensed,
            turn=turn,
            step=contact,
            free_colliders=free,
            friction_updates=self.settings.friction_updates,
            force_floor=self._force_floor,
            units=self._units,
            timings=timings,
        )

    def _result(
        self,
        solved: NewtonResult[Configuration],
        state: ReducedState,
        energy: StepEnergy,
        inertia: QuadraticForm,
        timings: Timings,
        free: FreeStep | None,
    ) -> StepResult[ReducedState]:
        rows, velocity = state.rows, state.rows_velocity
        found = energy.evaluate(solved.x)
        self._last = (state, energy.turn, found.surface)
        normal, friction, forces = energy.contacts(found)
        springs = self._pulled(state.time)
        weight, height = self._weight.form(energy.turn)
        energies = {
            "inertia": inertia.energy(rows),
            "kinetic": 0.5 * float(np.vdot(velocity, self.body.reduced_mass @ velocity)),
            "gravity": height - float(np.vdot(weight, rows)),
            "springs": springs.energy(rows),
            "elastic": found.elastic,
            "contact": normal,
            "friction": friction,
        }
        if self._movers:
            energies["inertia"] += 0.0 if free is None else free.inertia(state.poses)
            energies["kinetic"] += self._movers.kinetic(state.poses, state.motions)
            energies["gravity"] += self._movers.weight(state.poses, self._gravity)
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

    def _surface_of(self, state: ReducedState, turn: Array, timings: Timings) -> Array:
        """Corrected surface samples at a state; remembered for the state that the last step returned."""
        if self._last is not None:
            last, last_turn, surface = self._last
            if last is state and same(last_turn, turn):
                return surface
        displacement = self._points.displacement(state.rows, state.poses, timings.correction)
        return self._surface.positions(state.rows, turn, displacement)

    def surface_positions(self, state: ReducedState) -> Array:
        """(s, dim) [m]: the body's surface samples, corrections included: what a hand feels and an eye sees, at a
        cost that does not grow with the mesh."""
        return self._samples.positions(state)

    def surface_snapshot(self, state: ReducedState) -> Snapshot:
        """What `surface_drawn` makes the same of, later: see `CorrectedNodes`."""
        return self._samples.snapshot(state)

    def surface_drawn(self, snapshot: Snapshot) -> Array:
        """(s, dim) [m], on any thread or in another process, beside the next step (`background_drawing.py`)."""
        return self._samples.drawn(snapshot)

    def follow(self, nodes: IntArray) -> Callable[[ReducedState], Array]:
        """Where some nodes (n,) of the mesh are, (n, dim) [m], as a function of the state, corrections included: bound
        once, at a cost that does not grow with the mesh."""
        joint = self._condensed.joint
        return CorrectedNodes(self.body, self._corrections, self._internal, nodes, joint).positions

    def positions(self, state: ReducedState) -> Array:
        """(n_nodes, dim) [m]: every node of the mesh, corrections included. As costly as the mesh is
        large."""
        return self._nodes.positions(state)

    def contact_forces(self, state: ReducedState) -> dict[str, ContactForce]:
        """The normal forces on every collider at a state; those of a `StepResult` hold friction too."""
        turn = state.rows if state.turn is None else state.turn
        at_points = self._surface.forces(self._surface_of(state, turn, Timings()), state.poses, None)[2]
        return {**at_points, **self._condensed.forces(state.rows, state.poses, turn, None)[2]}

    def deformation_gradients(self, state: ReducedState, cells: IntArray | None = None) -> Array:
        """(n, dim, dim) F of the given cells of the mesh (all by default), corrections included."""
        return self.body.mesh.deformation_gradients(
            self.positions(state), slice(None) if cells is None else cells
        )
