"""Full-space dynamics: backward Euler as minimisation (thesis eq. 5.5), with the runtime's potentials and
words.

    x_new = argmin  1/(2 h^2) |x - x_old - h v_old|_M^2 + W_elastic + W_gravity + W_springs
                   + W_contact + W_friction

over all nodes but those of kinematic handles, which are placed. M is the lumped mass. This is the reference
that every reduced motion is compared with, and the rival that its speed is measured against.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fem_truth.full_space_elasticity import FullSpaceElasticity
from fem_truth.full_space_springs import linear_springs
from fem_truth.newton import NewtonResult, Status, minimise
from fem_truth.newton import NewtonSettings as FullNewtonSettings
from fem_truth.null_space import NullSpace
from fem_truth.potentials import Gravity, Inertia, LaggedFriction, Potential, SurfaceContact
from fem_truth.total_energy import ElasticTangent, Gradient, TotalEnergy
from runtime.arrays import Array, IntArray
from runtime.colliders.pose import Poses, RigidPose
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.contact.contact_force import SurfaceForces, resultant
from runtime.dynamics import (
    ContactForce,
    DynamicsSettings,
    HandleSpring,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    StepResult,
)
from runtime.dynamics.kinematic import place_kinematic
from runtime.errors import SoftprintError

if TYPE_CHECKING:
    from runtime.body import ReducedBody


@dataclass(frozen=True, eq=False)
class FullSpaceState:
    """time [s]; x (n_nodes, dim) positions [m]; velocity (n_nodes, dim) [m/s]; poses: of the colliders at
    this time."""

    time: float
    x: Array
    velocity: Array
    poses: Poses


class StepParts(NamedTuple):
    """The potentials of a step besides elasticity: smooth ones by name; contact and friction by collider."""

    smooth: Mapping[str, Sequence[Potential]]
    contacts: Mapping[str, SurfaceContact]
    friction: Mapping[str, LaggedFriction]


class StepEnergy(TotalEnergy):
    """The energy of one step. Residuals are measured against the largest of the forces that balance one
    another."""

    def __init__(
        self,
        elastic: FullSpaceElasticity,
        tangent: ElasticTangent,
        null_space: NullSpace,
        parts: StepParts,
        friction_updates: int,
        force_floor: float,
    ) -> None:
        smooth = [term for group in parts.smooth.values() for term in group]
        super().__init__(
            elastic, (*smooth, *parts.contacts.values(), *parts.friction.values()), null_space, tangent
        )
        self._contacts, self._friction = parts.contacts, parts.friction
        # `lag_friction` at the start is the first update.
        self._updates_left = friction_updates - 1 if parts.friction else 0
        self._floor = force_floor

    def lag_friction(self, x: Array) -> None:
        """Let friction take up the normal forces at x."""
        for name, friction in self._friction.items():
            friction.lag(self._contacts[name].terms(x))

    def stepped(self, x: Array, step: Array, before: Gradient, after: Gradient) -> bool:
        super().stepped(x, step, before, after)
        if self._updates_left == 0:
            return False
        self._updates_left -= 1
        self.lag_friction(x)
        return True

    def force_scale(self, x: Array, gradient: Gradient) -> float:
        contact = sum((contact.gradient(x) for contact in self._contacts.values()), np.zeros_like(x))
        elastic = float(np.linalg.norm(self.null_space.project(gradient.elastic)))
        return max(elastic, float(np.linalg.norm(self.null_space.project(contact))), self._floor)

    def energy_scale(self, x: Array) -> float:
        """1 J: a step is accepted on its residual alone, for inertia leaves no soft modes."""
        return 1.0


class FullSpaceSimulator:
    """Steps one body in full space; constructor words, methods and results are those of
    `runtime.dynamics.Simulator`.

    Kinematic handles are placed (the region of a frame rigidly); all other nodes are free, those of frames
    that are not kinematic too. Corrections of the colliders are of no concern here. The elastic Hessian is
    kept between steps while it serves: a step repeats to the last bit only after the same steps before it,
    and within the tolerance otherwise.
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
    ) -> None:
        for placed in colliders:
            if placed.free is not None:
                raise SoftprintError(
                    f"collider {placed.name!r} moves freely, which full space cannot play: give it keyframes, or play "
                    "the scene with a reduced model"
                )
        self.body = body
        self.colliders = tuple(colliders)
        self.settings = settings or DynamicsSettings()
        self.elasticity = FullSpaceElasticity(body) if elasticity is None else elasticity
        self._contact = contact
        self._friction = friction if friction is not None and friction.coefficient > 0 else None
        self._gravity = np.zeros(body.dim) if gravity is None else np.asarray(gravity, dtype=float)
        self._springs, self._kinematic = tuple(springs), tuple(kinematic)
        self._null_space = NullSpace(np.zeros((body.n_nodes, 0)), _kinematic_nodes(body, kinematic))
        self._tangent = ElasticTangent(self.elasticity)
        weight = float(np.linalg.norm(body.node_mass) * np.linalg.norm(self._gravity))
        self._force_floor = max(1e-9 * self.elasticity.unit_force, weight)

    def rest_state(self, time: float = 0.0, poses: Poses | None = None) -> FullSpaceState:
        """The undeformed body, not moving; kinematic handles where they are at ``time`` [s]."""
        x = self._place(self.body.mesh.points, time)
        return FullSpaceState(time, x, np.zeros_like(x), self._poses_at(time, poses))

    def step(self, state: FullSpaceState, poses: Poses | None = None) -> StepResult[FullSpaceState]:
        """One time step. ``poses``: of colliders at the *end* of the step, in place of their paths."""
        h = self.settings.time_step
        end = state.time + h
        inertia = Inertia(self.body.node_mass, state.x + h * state.velocity, h)
        newton = self.settings.newton
        # A single iteration (linearly implicit Euler) must get its linear solve right; more may start loose.
        loosest = 1e-3 if newton.max_iterations == 1 else 0.1
        settings = FullNewtonSettings(newton.tolerance, np.inf, newton.max_iterations, cg_tolerance=loosest)
        return self._solve(state, end, self._poses_at(end, poses), inertia, settings)

    def settle(
        self, state: FullSpaceState | None = None, newton: NewtonSettings | None = None
    ) -> StepResult[FullSpaceState]:
        """Static equilibrium near ``state`` (the rest state by default) at its time, without friction."""
        newton = newton or NewtonSettings(max_iterations=100, tolerance=1e-6)
        settings = FullNewtonSettings(newton.tolerance, np.inf, newton.max_iterations)
        state = state or self.rest_state()
        return self._solve(state, state.time, state.poses, None, settings)

    def at_rest(self) -> StepResult[FullSpaceState]:
        """The rest state as the result of no step at all: its energies and contact forces."""
        started, state = time.perf_counter(), self.rest_state()
        parts = self._parts(state, state.time, state.poses, None)
        nothing = NewtonResult(state.x, Status.CONVERGED, 0.0, 0.0, 0, 0, 0.0, 0.0, None)
        return self._report(state, parts, nothing, started)

    def positions(self, state: FullSpaceState) -> Array:
        """(n_nodes, dim) [m]."""
        return state.x

    def reduced_rows(self, state: FullSpaceState) -> Array:
        """(n_rows, dim) nearest handle rows (thesis 4.3.2); frames come out affine where their regions are
        strained."""
        return self.body.project(state.x)

    def deformation_gradients(self, state: FullSpaceState, cells: IntArray | None = None) -> Array:
        """(n, dim, dim) F of the given cells of the mesh (all by default)."""
        return self.body.mesh.deformation_gradients(state.x, slice(None) if cells is None else cells)

    def contact_forces(self, state: FullSpaceState) -> dict[str, ContactForce]:
        """The normal forces on every collider at a state; those of a `StepResult` hold friction too."""
        contacts = self._parts(state, state.time, state.poses, None).contacts
        return {name: _contact_force(contact, None, state.x) for name, contact in contacts.items()}

    def _solve(
        self,
        state: FullSpaceState,
        end: float,
        poses: Poses,
        inertia: Inertia | None,
        settings: FullNewtonSettings,
    ) -> StepResult[FullSpaceState]:
        started = time.perf_counter()
        parts = self._parts(state, end, poses, inertia)
        energy = StepEnergy(
            self.elasticity,
            self._tangent,
            self._null_space,
            parts,
            self.settings.friction_updates,
            self._force_floor,
        )
        x0 = self._place(state.x, end)
        energy.lag_friction(x0)
        if inertia is not None:
            # Free motion is a better start than none (a third of the iterations less), but where it meets a collider.
            moved = self._place(inertia.predicted, end)
            if energy.evaluate(moved)[0] < energy.evaluate(x0)[0]:
                x0 = moved
                energy.lag_friction(x0)
        result = minimise(energy, x0, settings)
        h = self.settings.time_step
        velocity = np.zeros_like(x0) if inertia is None else (result.x - state.x) / h
        return self._report(FullSpaceState(end, result.x, velocity, poses), parts, result, started)

    def _parts(self, state: FullSpaceState, end: float, poses: Poses, inertia: Inertia | None) -> StepParts:
        """The potentials of a step from ``state`` to the time ``end`` [s]; without inertia a static solve, no
        friction."""
        mesh = self.body.mesh
        contacts = {
            placed.name: SurfaceContact(
                self._contact, mesh.surface_nodes, mesh.surface_areas, placed.collider, poses[placed.name]
            )
            for placed in self.colliders
        }
        friction: dict[str, LaggedFriction] = {}
        if self._friction is not None and inertia is not None:
            nodes, h = mesh.surface_nodes, self.settings.time_step
            friction = {
                name: LaggedFriction(self._friction, nodes, state.x[nodes], state.poses[name], poses[name], h)
                for name in contacts
            }
        smooth: dict[str, list[Potential]] = {
            "inertia": [] if inertia is None else [inertia],
            "gravity": [Gravity(self.body.node_mass, self._gravity, np.zeros_like(mesh.points))],
            "springs": list(linear_springs(self._springs, self.body, end)),
        }
        return StepParts(smooth, contacts, friction)

    def _report(
        self, state: FullSpaceState, parts: StepParts, result: NewtonResult, started: float
    ) -> StepResult[FullSpaceState]:
        x, contacts, friction = state.x, parts.contacts, parts.friction
        energies = {
            name: float(sum(term.energy(x) for term in group)) for name, group in parts.smooth.items()
        }
        energies["kinetic"] = 0.5 * float(self.body.node_mass @ (state.velocity**2).sum(axis=1))
        energies["elastic"] = self.elasticity.energy(x)
        energies["contact"] = float(sum(term.energy(x) for term in contacts.values()))
        energies["friction"] = float(sum(term.energy(x) for term in friction.values()))
        numbers = f"iterations {result.newton_iterations}, residual {result.residual:.1e}"
        return StepResult(
            state=state,
            status=result.status,
            reason=f"{result.status.sentence} ({numbers})",
            iterations=result.newton_iterations,
            residual=result.residual,
            energies=energies,
            timings={"total": time.perf_counter() - started},
            contacts={name: _contact_force(contacts[name], friction.get(name), x) for name in contacts},
        )

    def _poses_at(self, at: float, given: Poses | None) -> dict[str, RigidPose]:
        poses = dict(given or {})
        for placed in self.colliders:
            if placed.name not in poses:
                if placed.path is None:
                    raise SoftprintError(
                        f"collider {placed.name!r} has no path: give its pose with every step"
                    )
                poses[placed.name] = placed.path.pose(at)
        return poses

    def _place(self, x: Array, at: float) -> Array:
        """x with the nodes of kinematic handles where they have to be at time ``at`` [s]; a copy."""
        rest, handles = self.body.rest_rows, self.body.handles
        rows = place_kinematic(rest, rest, handles, self._kinematic, at)
        x = x.copy()
        for held in self._kinematic:
            block = rows[handles.rows_of(held.handle)]
            if isinstance(held.handle, str):
                nodes = _frame_nodes(self.body, held.handle)
                x[nodes] = self.body.mesh.points[nodes] @ block[:-1] + block[-1]
            else:
                x[handles.points[held.handle]] = block[0]
        return x


def _frame_nodes(body: ReducedBody, name: str) -> IntArray:
    return next(frame for frame in body.handles.frames if frame.name == name).nodes


def _kinematic_nodes(body: ReducedBody, kinematic: Sequence[KinematicHandle]) -> IntArray:
    nodes = [
        _frame_nodes(body, held.handle)
        if isinstance(held.handle, str)
        else body.handles.points[[held.handle]]
        for held in kinematic
    ]
    return np.unique(np.concatenate([*nodes, np.empty(0, dtype=np.int64)])).astype(np.int64)


def _contact_force(contact: SurfaceContact, friction: LaggedFriction | None, x: Array) -> ContactForce:
    """What the body does to the collider: the gradient at a node of the body is the force that the body
    exerts."""
    parts = [(contact.gradient(x), False)]
    if friction is not None:
        parts.append((friction.gradient(x), True))
    loads = []
    for gradient, tangential in parts:
        index = np.flatnonzero(gradient[contact.nodes].any(axis=1))
        borne = contact.nodes[index]
        loads.append(SurfaceForces(contact.nodes, index, x[borne], gradient[borne], tangential))
    force, torque = resultant(loads, contact.pose.translation)
    return ContactForce(force, torque, contact.max_depth(x), len(contact.terms(x).index), loads)
