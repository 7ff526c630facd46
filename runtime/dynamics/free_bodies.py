"""Free rigid bodies: the colliders of a scene that move freely, as unknowns of a step beside the handle rows.

Each adds a twist about its centre of mass (`runtime/rigid/twist.py`), its inertia and weight
(`runtime/rigid/flight.py`), and its contact with all other colliders (`free_body_contact.py`). In the vector of all
unknowns of the step the twists follow the handles, collider by collider, with angles scaled to metres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.collider_coupling import Centres, Coupling, Link
from softprint.runtime.contact.lagged_friction import LaggedFriction
from softprint.runtime.dynamics.free_body_contact import ColliderContact
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.optimise import Linearisation
from softprint.runtime.rigid.flight import FreeFlight, RigidMotion, centre_of, moved
from softprint.runtime.rigid.free_collider import FreeCollider
from softprint.runtime.rigid.twist import twist_size

# Near other surfaces a collider moves by at most this fraction of its smallest half extent between two evaluations of
# contact, so that it cannot pass through a surface undetected.
_HOP = 0.3
# Bound on the displacement of the body's surface by corrections and static condensation, as a fraction of the
# collider's size.
_ROOM = 0.25
# A force that moves a collider in a step by less than this fraction of its size counts as balanced.
_NEGLIGIBLE_SHIFT = 1e-6
# The least scale of the forces on one free collider, of that of all: forces by the contact solve are no more exact.
_LEAST_SCALE = 1e-3
# As in `step_energy.py`.
_ROUND_OFF = 1e-13


class MovingState(Protocol):
    """What a step needs of the state that it starts at."""

    @property
    def poses(self) -> Poses: ...
    @property
    def motions(self) -> Mapping[str, RigidMotion]: ...


class FreeBodies:
    """The free colliders of a scene, and their contact with one another and with all others."""

    def __init__(
        self,
        free: Mapping[str, FreeCollider],
        shapes: Mapping[str, Collider],
        contact: ColliderContact,
        surface: Callable[[Array], Array],
    ) -> None:
        """surface: computes points (s, dim) [m] on the surface of the body from the rows of a configuration, to find
        those near a collider."""
        self.free = dict(free)
        self.contact = contact
        self._shapes, self._surface = shapes, surface
        self._twist = twist_size(next(iter(shapes.values())).dim) if shapes else 0
        # Half the extent of a collider converts its angles to lengths.
        of_free = [shapes[name] for name in self.free]
        units = [np.r_[np.ones(s.dim), np.full(self._twist - s.dim, 1.0 / s.size)] for s in of_free]
        self.units: Array = np.concatenate([*units, np.empty(0)])

    def __bool__(self) -> bool:
        return bool(self.free)

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return len(self.units)

    def size_of(self, name: str) -> float:
        """The size of a collider [m]."""
        return self._shapes[name].size

    def slot(self, name: str) -> slice:
        """The unknowns of one collider."""
        first = self._twist * list(self.free).index(name)
        return slice(first, first + self._twist)

    def retract(self, poses: Poses, v: Array) -> Poses:
        """Poses after the increment v (n,)."""
        new_poses = dict(poses)
        twists = v * self.units
        for name, collider in self.free.items():
            new_poses[name] = moved(collider.mass, poses[name], twists[self.slot(name)])
        return new_poses

    def longest(self, x: Configuration, twists: Array) -> float:
        """The largest fraction of twists (n,), in metres and radians, that one step may take."""
        share = 1.0
        surface: Array | None = None
        for name, free in self.free.items():
            shape, twist = self._shapes[name], twists[self.slot(name)]
            reach = float(np.linalg.norm(free.points - free.mass.centre, axis=1).max())
            step = float(np.linalg.norm(twist[: shape.dim]) + reach * np.linalg.norm(twist[shape.dim :]))
            hop = _HOP * 0.5 * float((shape.upper - shape.lower).min())
            if step * share <= hop:
                continue
            if surface is None:
                surface = self._surface(x.rows)
            beside = shape.about(x.poses[name].apply_inverse(surface), step + _ROOM * shape.size)
            if len(beside) or self.contact.near(name, x.poses, step):
                share = hop / step
        return share

    def centres(self, poses: Poses) -> Centres:
        """Centres of mass of the free colliders."""
        return {name: centre_of(collider.mass, poses[name]) for name, collider in self.free.items()}

    def weight(self, poses: Poses, gravity: Array) -> float:
        """Potential energy in gravity (dim,) [m/s^2], [J]."""
        centres = self.centres(poses)
        return -sum(float(self.free[name].mass.mass * gravity @ centre) for name, centre in centres.items())

    def kinetic(self, poses: Poses, motions: Mapping[str, RigidMotion]) -> float:
        """Kinetic energy [J]."""
        return sum(motions[name].energy(collider.mass, poses[name]) for name, collider in self.free.items())

    def step(self, state: MovingState, time_step: float, gravity: Array) -> FreeStep:
        """A step of time_step [s] that starts at a state."""
        flights = {
            name: FreeFlight(collider.mass, state.poses[name], state.motions[name], time_step, gravity)
            for name, collider in self.free.items()
        }
        return FreeStep(self, flights)


@dataclass(frozen=True, eq=False)
class TwistDerivatives:
    """Of the energy of the free colliders by their twists [m, rad]. flying (n,): by their inertia and weight; touching
    (n,): by contact; hessian: (n, n)."""

    energy: float
    flying: Array
    touching: Array
    hessian: Array


@dataclass(frozen=True, eq=False)
class FreeStep:
    """One step: the motion of each collider without contact."""

    bodies: FreeBodies
    flights: Mapping[str, FreeFlight]

    def carried_on(self, poses: Poses, share: float = 1.0) -> Poses:
        """Poses with the free colliders moved by their momenta alone for a fraction of the step."""
        return {**poses, **{name: flight.carried_on(share) for name, flight in self.flights.items()}}

    def start(self, rows: Array, poses: Poses, energy: Callable[[Configuration], float]) -> Configuration:
        """The starting point of the minimisation: the free colliders moved by their momenta for as long as the energy
        does not increase, in steps that are too short to pass through anything."""
        at, end = (Configuration(rows, self.carried_on(poses, share)) for share in (0.0, 1.0))
        motion = np.concatenate([flight.step for flight in self.flights.values()])
        hops = int(np.ceil(1.0 / self.bodies.longest(at, motion)))
        if hops == 1:
            return end
        least = energy(at)
        for hop in range(1, hops + 1):
            ahead = Configuration(rows, self.carried_on(poses, hop / hops))
            found = energy(ahead)
            if found > least:
                break
            at, least = ahead, found
        return at

    def motions(self, poses: Poses) -> dict[str, RigidMotion]:
        """The motions of the free colliders at the end of the step, at poses."""
        return {name: flight.motion_at(poses[name]) for name, flight in self.flights.items()}

    def inertia(self, poses: Poses) -> float:
        """The inertia term of the incremental energy [J]."""
        return sum(flight.energies(poses[name])[0] for name, flight in self.flights.items())

    def among(self, poses: Poses, lagged: LaggedFriction | None) -> tuple[float, float]:
        """Energies of contact and of lagged friction between colliders [J]."""
        return self.bodies.contact.energies(poses, lagged)

    def longest(self, x: Configuration, v: Array) -> float:
        """The largest fraction of the increment v (n,) that one step may take."""
        return self.bodies.longest(x, v * self.bodies.units)

    @cached_property
    def floor(self) -> float:
        """The force below which forces count as balanced [N]."""
        sizes = ((flight.inert, self.bodies.size_of(name)) for name, flight in self.flights.items())
        return _NEGLIGIBLE_SHIFT * max(inert * size for inert, size in sizes)

    def energy(self, poses: Poses, lagged: LaggedFriction | None) -> float:
        """All energy of the free colliders except their contact with the body [J]."""
        flying = sum(sum(flight.energies(poses[name])) for name, flight in self.flights.items())
        return flying + sum(self.among(poses, lagged))

    def alone(self, poses: Poses, lagged: LaggedFriction | None) -> TwistDerivatives:
        """The derivatives of `energy`."""
        bodies = self.bodies
        n, energy = bodies.size, 0.0
        flying, touching, hessian = np.zeros(n), np.zeros(n), np.zeros((n, n))
        for name, flight in self.flights.items():
            at = bodies.slot(name)
            energy += sum(flight.energies(poses[name]))
            flying[at], hessian[at, at] = flight.linearise(poses[name])
        for pair in bodies.contact.linearise(poses, bodies.centres(poses), lagged):
            energy += pair.energy
            for name, slope in pair.gradients(bodies.free):
                touching[bodies.slot(name)] += slope
            for one, other, block in pair.blocks(bodies.free):
                hessian[bodies.slot(one), bodies.slot(other)] += block
        return TwistDerivatives(energy, flying, touching, hessian)

    def coupled(self, couplings: Sequence[Coupling], n_rows: int) -> tuple[Array, Array]:
        """The second derivatives of the contacts of the body: by its n_rows coordinates and the twists (n_rows, n), and
        by the twists (n, n)."""
        bodies = self.bodies
        mixed, twisted = np.zeros((n_rows, bodies.size)), np.zeros((bodies.size, bodies.size))
        for coupling in couplings:
            at = bodies.slot(coupling.name)
            by_both, by_twist = coupling.blocks()
            mixed[:, at] += by_both
            twisted[at, at] += by_twist
        return mixed, twisted

    def joined(
        self,
        body: Linearisation,
        poses: Poses,
        couplings: Sequence[Coupling],
        links: Sequence[Link],
        tangent: Array,
        lagged: LaggedFriction | None,
        timings: Timings,
    ) -> Linearisation:
        """The linearisation by all unknowns, those of the body first. body: by the unknowns of the body alone;
        couplings: of the body with free colliders; links: of free colliders with each other through the body; tangent:
        d rows / d unknowns of the body; lagged: see `LaggedFriction`."""
        bodies, units = self.bodies, self.bodies.units
        with timings.contact:
            own = self.alone(poses, lagged)
            touching = own.touching.copy()
            for coupling in couplings:
                touching[bodies.slot(coupling.name)] += coupling.gradient
        flying, touching = units * own.flying, units * touching

        def joint() -> Array:
            hessian = body.hessian
            m, n = len(hessian), bodies.size
            with timings.contact:
                mixed, twisted = self.coupled(couplings, len(tangent))
                twisted += own.hessian
                for first, second, block in links:
                    one, other, linked = bodies.slot(first), bodies.slot(second), block()
                    twisted[one, other] += linked
                    twisted[other, one] += linked.T
            full = np.empty((m + n, m + n))
            full[:m, :m] = hessian
            full[:m, m:] = (tangent.T @ mixed) * units
            full[m:, :m] = full[:m, m:].T
            full[m:, m:] = units[:, None] * twisted * units
            return full

        return Linearisation(
            energy=body.energy + own.energy,
            noise=body.noise + _ROUND_OFF * abs(own.energy),
            gradient=np.concatenate([body.gradient, flying + touching]),
            second_derivative=joint,
            scale=self._scale(body, flying, touching),
        )

    def _scale(self, body: Linearisation, flying: Array, touching: Array) -> Array:
        """(n,) [N] of all unknowns: the largest of the forces that balance, of the body and of each free collider by
        itself. By that of all together, the weight of a light one would count as balanced."""
        sizes = float(np.linalg.norm(flying)), float(np.linalg.norm(touching))
        most = max(float(np.max(body.scale)), self.floor, *sizes)
        scale = np.full(len(flying), _LEAST_SCALE * most)
        for name in self.flights:
            at = self.bodies.slot(name)
            own = max(float(np.linalg.norm(flying[at])), float(np.linalg.norm(touching[at])))
            scale[at] = max(own, _LEAST_SCALE * most)
        return np.concatenate([np.full(len(body.gradient), most), scale])
