"""Full-space dynamics: backward Euler as minimisation (thesis eq. 5.5), with the runtime's potentials and
terms.

    x_new = argmin  1/(2 h^2) |x - x_old - h v_old|_M^2 + W_elastic + W_gravity + W_springs
                   + W_contact + W_friction

over all nodes, while kinematic handles have prescribed positions (`full_space_handles.py`). M is the lumped mass.
Colliders that move freely are solved for together with the nodes (`free_body_energy.py`). This is the reference for the
accuracy and for the speed of every reduced motion.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from softprint.fem_truth.dynamics.collision_free_way import CollisionFreeWay, surfaces_of
from softprint.fem_truth.dynamics.free_body_energy import FreeBodyEnergy, slip_start
from softprint.fem_truth.dynamics.full_space_forces import contact_force
from softprint.fem_truth.dynamics.full_space_handles import FullSpaceHandles
from softprint.fem_truth.dynamics.full_space_state import FullSpaceState
from softprint.fem_truth.dynamics.full_space_step_energy import Contact, StepEnergy, StepParts
from softprint.fem_truth.dynamics.full_space_surface import DeformedBody, full_space_search
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.full_space_springs import linear_springs
from softprint.fem_truth.energy.moving_contact import MovingContact
from softprint.fem_truth.energy.potentials import Gravity, Inertia, Potential
from softprint.fem_truth.energy.surface_contact import LaggedFriction, SurfaceContact
from softprint.fem_truth.energy.total_energy import ElasticTangent
from softprint.fem_truth.parts.body_part import whole_body
from softprint.fem_truth.statics.newton import FullSpaceSettings, NewtonResult, minimise
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.contact.lagged_friction import LaggedFriction as LaggedPairs
from softprint.runtime.contact.sharp_planes import SharpPlanes, SharpSurface, undented_normals
from softprint.runtime.dynamics import (
    ContactForce,
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Status,
    StepResult,
)
from softprint.runtime.dynamics.free_bodies import FreeBodies, FreeStep
from softprint.runtime.dynamics.free_body_contact import ColliderContact
from softprint.runtime.dynamics.pierced_colliders import with_piercing
from softprint.runtime.dynamics.placed_collider import (
    check_colliders,
    free_colliders,
    poses_after,
    poses_at,
    starting_motions,
)
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.errors import SoftprintError

if TYPE_CHECKING:
    from softprint.fem_truth.energy.barrier_contact import BarrierLaw
    from softprint.runtime.body import ReducedBody

# Contact by a barrier: the tolerance of the minimisations before the last of a step, and how many there may be.
_LOOSE = 1e-2
_STAGES = 100


class FullSpaceSimulator:
    """Steps one body in full space; constructor arguments, methods and results are those of
    `runtime.dynamics.Simulator`.

    The region of a frame moves rigidly; kinematic handles have prescribed positions, a point as a projection. All
    other nodes are free, and with a barrier those of non-kinematic frames. Corrections of the colliders are ignored.
    The elastic Hessian is reused between steps while it converges fast enough: a step is bitwise reproducible only
    after the same previous steps, otherwise within the tolerance.
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
        elasticity: FullSpaceElasticity | None = None,
        barrier: BarrierLaw | None = None,
    ) -> None:
        """barrier: in place of the penalty `contact` (`fem_truth/energy/barrier_contact.py`)."""
        self.body, self.colliders = body, tuple(colliders)
        # Corrections are ignored, and so may be unfit.
        check_colliders([replace(placed, correction=None) for placed in colliders], body, None, contact)
        self.settings = settings or DynamicsSettings()
        if self.settings.optimiser is not None:
            raise SoftprintError(
                "full space is solved by its own Newton's method: give it settings without an optimiser"
            )
        self.elasticity = FullSpaceElasticity(body) if elasticity is None else elasticity
        self._contact = contact
        self._surfaces = {} if barrier is None else surfaces_of(body, self.colliders, barrier, friction)
        self._contact_points = whole_body(body).contact_points(contact.refinement)
        self._sharp = [
            None if self._surfaces else SharpSurface.of(placed.collider, contact, body.mesh)
            for placed in self.colliders
        ]
        self._friction = friction if friction is not None and friction.coefficient > 0 else None
        self._gravity = np.zeros(body.dim) if gravity is None else np.asarray(gravity, dtype=float)
        self._springs = tuple(springs)
        # The line search of a barrier follows straight lines, which rigid regions leave as they turn.
        self._handles = FullSpaceHandles(body, kinematic, soft_frames=barrier is not None)
        self._null_space = self._handles.null_space
        self._tangent = ElasticTangent(self.elasticity)
        weight = float(np.linalg.norm(body.node_mass) * np.linalg.norm(self._gravity))
        self._force_floor = max(1e-9 * self.elasticity.unit_force, weight)
        shapes, free = {c.name: c.collider for c in self.colliders}, free_colliders(self.colliders)
        among = ColliderContact(free, shapes, contact, self._friction)
        surface = body.mesh.surface_nodes
        self._free_bodies = FreeBodies(free, shapes, among, lambda x: x[surface])
        self._pierced = full_space_search(body.mesh, {name: shapes[name] for name in free})

    def rest_state(self, time: float = 0.0, poses: Poses | None = None) -> FullSpaceState:
        """The undeformed body at rest, with kinematic handles at their positions at ``time`` [s]."""
        x = self._handles.place(self.body.mesh.points, time)
        where = poses_at(self.colliders, time, poses)
        return FullSpaceState(time, x, np.zeros_like(x), where, starting_motions(self.colliders))

    def step(self, state: FullSpaceState, poses: Poses | None = None) -> StepResult[FullSpaceState]:
        """One time step. ``poses``: collider poses at the *end* of the step, which replace those of their paths."""
        h = self.settings.time_step
        end = state.time + h
        inertia = Inertia(self.body.node_mass, state.x + h * state.velocity, h)
        newton = self.settings.newton
        # A single iteration (linearly implicit Euler) needs an accurate linear solve; several may start loosely.
        loosest = 1e-3 if newton.max_iterations == 1 else 0.1
        settings = FullSpaceSettings(newton, np.inf, cg_tolerance=loosest)
        return self._solve(
            state, end, poses_after(self.colliders, end, poses, state.poses), inertia, settings
        )

    def settle(
        self, state: FullSpaceState | None = None, newton: NewtonSettings | None = None
    ) -> StepResult[FullSpaceState]:
        """Static equilibrium, started from ``state`` (default: the rest state), at its time, without friction;
        colliders that move freely keep their poses and motions."""
        settings = FullSpaceSettings(newton or NewtonSettings(max_iterations=100, tolerance=1e-6), np.inf)
        state = state or self.rest_state()
        return self._solve(state, state.time, state.poses, None, settings)

    def at_rest(self) -> StepResult[FullSpaceState]:
        """The rest state as a result without a step: its energies and contact forces."""
        started, state = time.perf_counter(), self.rest_state()
        parts = self._parts(state, state.time, state.poses, None)
        nothing = NewtonResult(
            state.x, np.zeros_like(state.x), Status.CONVERGED, 0.0, 0.0, 0, 0, 0.0, 0.0, None
        )
        return self._report(state, parts, nothing, started)

    def positions(self, state: FullSpaceState) -> Array:
        """(n_nodes, dim) [m]."""
        return state.x

    def deformation_gradients(self, state: FullSpaceState, cells: IntArray | None = None) -> Array:
        """(n, dim, dim) F of the given cells of the mesh (default: all)."""
        return self.body.mesh.deformation_gradients(state.x, slice(None) if cells is None else cells)

    def contact_forces(self, state: FullSpaceState) -> dict[str, ContactForce]:
        """The normal forces on every collider at a state; those in a `StepResult` include friction."""
        contacts = self._parts(state, state.time, state.poses, None).contacts
        return {name: contact_force(contact, None, state.x) for name, contact in contacts.items()}

    def _solve(
        self,
        state: FullSpaceState,
        end: float,
        poses: Poses,
        inertia: Inertia | None,
        settings: FullSpaceSettings,
    ) -> StepResult[FullSpaceState]:
        started = time.perf_counter()
        if self._surfaces:
            return self._solve_without_collision(state, end, poses, inertia, settings, started)
        parts = self._parts(state, end, poses, inertia)
        if self._free_bodies and inertia is not None:
            return self._solve_with_free_bodies(state, end, poses, inertia, settings, parts, started)
        energy = self._energy(parts)
        x0 = self._handles.place(state.x, end)
        energy.lag_friction(x0)
        if inertia is not None:
            # Starting from free motion saves a third of the iterations, except where it runs into a collider.
            least = energy.evaluate(x0)[0]
            moved = self._handles.place(inertia.predicted, end)
            energy.hold(moved)
            if energy.evaluate(moved)[0] < least:
                x0 = moved
                energy.lag_friction(x0)
            else:
                energy.hold(x0)
        result = minimise(energy, x0, settings)
        h = self.settings.time_step
        velocity = np.zeros_like(x0) if inertia is None else (result.x - state.x) / h
        reached = FullSpaceState(end, result.x, velocity, poses, state.motions)
        found = self._report(reached, parts, result, started)
        body = DeformedBody(Configuration(result.x, poses))
        return with_piercing(found, self._pierced.deepest(body, body, ()))

    def _solve_with_free_bodies(
        self,
        state: FullSpaceState,
        end: float,
        poses: Poses,
        inertia: Inertia,
        settings: FullSpaceSettings,
        parts: StepParts,
        started: float,
    ) -> StepResult[FullSpaceState]:
        """The nodes of the body and the free colliders together. parts: with these where they are at the start."""
        h, names = self.settings.time_step, list(self._free_bodies.free)
        free = self._free_bodies.step(state, h, self._gravity)
        begin = DeformedBody(Configuration(state.x, state.poses))
        moving = {
            placed.name: MovingContact(
                placed.name,
                self._contact,
                self._contact_points,
                placed.collider,
                sharp,
                parts.friction.get(placed.name),
            )
            for placed, sharp in zip(self.colliders, self._sharp_planes(state.x, moving=True), strict=True)
            if placed.free is not None
        }
        led = StepParts(
            parts.smooth,
            {name: contact for name, contact in parts.contacts.items() if name not in moving},
            {name: friction for name, friction in parts.friction.items() if name not in moving},
        )
        slip = None if self._friction is None else slip_start(state, h)
        limit = self._pierced.limit(begin, names)
        updates = self.settings.friction_updates
        problem = FreeBodyEnergy(self._energy(led, 1), free, list(moving.values()), slip, updates, limit)
        still, moved = (self._handles.place(x, end) for x in (state.x, inertia.predicted))
        start = problem.start([still, moved], Configuration(still, poses))
        problem.lag_friction(start)
        result = minimise(problem, start, settings)
        x, poses = result.x
        reached = FullSpaceState(end, x, (x - state.x) / h, poses, free.motions(poses))
        contacts = {
            name: moving[name].at(poses[name]) if name in moving else c for name, c in parts.contacts.items()
        }
        found = self._report(
            reached, parts._replace(contacts=contacts), result, started, free, problem.lagged
        )
        released = {name for name in names if not found.contacts[name].points}
        piercing = self._pierced.deepest(begin, DeformedBody(result.x), released)
        if piercing is None:
            piercing = self._pierced.penetrating(found.contacts)
        if piercing is None and not result.converged:
            piercing = limit.refused
        return with_piercing(found, piercing)

    def _solve_without_collision(
        self,
        state: FullSpaceState,
        end: float,
        poses: Poses,
        inertia: Inertia | None,
        settings: FullSpaceSettings,
        started: float,
    ) -> StepResult[FullSpaceState]:
        """With a barrier: the colliders are moved as far as they meet nothing, the body is minimised, and so on until
        they are at their poses."""
        way = CollisionFreeWay(self._surfaces, state.x, state.poses)
        way.require_apart()
        loose = replace(settings, newton=replace(settings.newton, tolerance=_LOOSE))
        target = self._handles.place(state.x if inertia is None else inertia.predicted, end)
        iterations = 0
        for _ in range(_STAGES):
            arrived, x0 = way.advance(target, self._handles.place(way.x, end), poses)
            parts = self._parts(state, end, way.poses, inertia, x0)
            result = minimise(self._energy(parts), x0, settings if arrived else loose)
            iterations += result.newton_iterations
            target = self._handles.place(way.continued(result.x), end)
            if arrived or result.status is Status.NOT_FINITE:
                break
        status = result.status if arrived else Status.MAX_ITERATIONS
        result = replace(result, newton_iterations=iterations, status=status)
        velocity = np.zeros_like(x0) if inertia is None else (result.x - state.x) / self.settings.time_step
        return self._report(FullSpaceState(end, result.x, velocity, way.poses), parts, result, started)

    def _energy(self, parts: StepParts, updates: int | None = None) -> StepEnergy:
        """updates: of friction, by default those of the settings."""
        updates = updates or self.settings.friction_updates
        return StepEnergy(
            self.elasticity,
            self._tangent,
            self._null_space,
            self._handles,
            parts,
            updates,
            self._force_floor,
        )

    def _sharp_planes(self, x: Array, moving: bool) -> list[SharpPlanes | None]:
        """Those of all colliders for a solve that starts at positions x; moving: a step of time."""
        if not any(self._sharp):
            return [None] * len(self._sharp)
        normals = undented_normals(self.body, self.body.project(x))
        renewals = SharpPlanes.IN_STEP if moving else np.inf
        return [own if own is None else SharpPlanes(own, normals, renewals=renewals) for own in self._sharp]

    def _contacts(self, poses: Poses, x: Array, moving: bool) -> dict[str, Contact]:
        """Contact with every collider, from positions x; moving: in a step of time."""
        if self._surfaces:
            from softprint.fem_truth.energy.barrier_contact import BarrierContact

            return {name: BarrierContact(own, poses[name], x) for name, own in self._surfaces.items()}
        return {
            placed.name: SurfaceContact(
                self._contact, self._contact_points, placed.collider, poses[placed.name], sharp
            )
            for placed, sharp in zip(self.colliders, self._sharp_planes(x, moving), strict=True)
        }

    def _parts(
        self,
        state: FullSpaceState,
        end: float,
        poses: Poses,
        inertia: Inertia | None,
        x: Array | None = None,
    ) -> StepParts:
        """The potentials of a step from ``state`` to the time ``end`` [s]; a static solve has no inertia and no
        friction. x: where the minimisation starts, by default at the state."""
        mesh = self.body.mesh
        contacts = self._contacts(poses, state.x if x is None else x, inertia is not None)
        friction: dict[str, LaggedFriction] = {}
        if self._friction is not None and inertia is not None:
            h = self.settings.time_step
            friction = {
                name: LaggedFriction(self._friction, state.x, state.poses[name], poses[name], h)
                for name in contacts
            }
        smooth: dict[str, list[Potential]] = {
            "inertia": [] if inertia is None else [inertia],
            "gravity": [Gravity(self.body.node_mass, self._gravity, np.zeros_like(mesh.points))],
            "springs": list(linear_springs(self._springs, self.body, end)),
        }
        return StepParts(smooth, contacts, friction)

    def _report(
        self,
        state: FullSpaceState,
        parts: StepParts,
        result: NewtonResult[Any],
        started: float,
        free: FreeStep | None = None,
        lagged: LaggedPairs | None = None,
    ) -> StepResult[FullSpaceState]:
        """free, lagged: of a step with free colliders, and the friction between colliders."""
        x, contacts, friction = state.x, parts.contacts, parts.friction
        energies = {
            name: float(sum(term.energy(x) for term in group)) for name, group in parts.smooth.items()
        }
        energies["kinetic"] = 0.5 * float(self.body.node_mass @ (state.velocity**2).sum(axis=1))
        energies["elastic"] = self.elasticity.energy(x)
        energies["contact"] = float(sum(term.energy(x) for term in contacts.values()))
        energies["friction"] = float(sum(term.energy(x) for term in friction.values()))
        if self._free_bodies:
            energies["kinetic"] += self._free_bodies.kinetic(state.poses, state.motions)
            energies["gravity"] += self._free_bodies.weight(state.poses, self._gravity)
        if free is not None:
            among = free.among(state.poses, lagged)
            energies["inertia"] += free.inertia(state.poses)
            energies["contact"] += among[0]
            energies["friction"] += among[1]
        numbers = f"iterations {result.newton_iterations}, residual {result.residual:.1e}"
        return StepResult(
            state=state,
            status=result.status,
            reason=f"{result.status.sentence} ({numbers})",
            iterations=result.newton_iterations,
            residual=result.residual,
            energies=energies,
            timings={"total": time.perf_counter() - started},
            contacts={name: contact_force(contacts[name], friction.get(name), x) for name in contacts},
        )
