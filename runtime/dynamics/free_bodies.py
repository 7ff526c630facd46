"""The colliders of a scene that move freely, as unknowns of a step beside the handle rows.

Each brings a twist about its centre of mass (`runtime/rigid/twist.py`), its inertia and weight (`runtime/rigid/
flight.py`), and the contact with all other colliders (`free_body_contact.py`). In the vector of all unknowns of the
step the twists follow the handles, collider by collider, angles scaled to metres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from runtime.arrays import Array
from runtime.colliders.collider import Collider
from runtime.colliders.pose import Poses
from runtime.contact.collider_coupling import Centres, Coupling, Link
from runtime.dynamics.free_body_contact import ColliderContact, ColliderFriction
from runtime.dynamics.newton import Linearisation
from runtime.dynamics.state import Configuration, ReducedState
from runtime.dynamics.timings import Timings
from runtime.rigid.flight import FreeFlight, RigidMotion, centre_of, moved
from runtime.rigid.free_collider import FreeCollider
from runtime.rigid.twist import twist_size

# Near other things a collider moves at most by this share of its smallest half extent at a time, so that it cannot pass
# through a surface between two looks at it.
_HOP = 0.3
# What corrections and the internal response may add to where the surface of the body is, of the collider's size.
_ROOM = 0.25
# A force that moves a collider in a step by less than this share of its size is not worth balancing.
_NEGLIGIBLE_SHIFT = 1e-6
# As in `step_energy.py`.
_ROUND_OFF = 1e-13


class FreeBodies:
    """The free colliders of a scene, and their contact with one another and with all others."""

    def __init__(
        self,
        free: Mapping[str, FreeCollider],
        shapes: Mapping[str, Collider],
        contact: ColliderContact,
        basis: Array,
    ) -> None:
        """basis: (s, n_rows) of the surface of the body, to know what is near it."""
        self.free = dict(free)
        self.contact = contact
        self._shapes, self._basis = shapes, basis
        self._twist = twist_size(next(iter(shapes.values())).dim) if shapes else 0
        # Half the extent of a collider turns its angles into lengths.
        of_free = [shapes[name] for name in self.free]
        units = [np.r_[np.ones(s.dim), np.full(self._twist - s.dim, 1.0 / s.size)] for s in of_free]
        self.units: Array = np.concatenate([*units, np.empty(0)])

    def __bool__(self) -> bool:
        return bool(self.free)

    @property
    def size(self) -> int:
        """Unknowns."""
        return len(self.units)

    def size_of(self, name: str) -> float:
        """Of a collider [m]."""
        return self._shapes[name].size

    def slot(self, name: str) -> slice:
        """Those of one collider."""
        first = self._twist * list(self.free).index(name)
        return slice(first, first + self._twist)

    def retract(self, poses: Poses, v: Array) -> Poses:
        """Poses after the increment v (n,)."""
        turned = dict(poses)
        twists = v * self.units
        for name, collider in self.free.items():
            turned[name] = moved(collider.mass, poses[name], twists[self.slot(name)])
        return turned

    def longest(self, x: Configuration, twists: Array) -> float:
        """The share of twists (n,), in metres and radians, that can be gone at once."""
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
                surface = self._basis @ x.rows
            beside = shape.about(x.poses[name].apply_inverse(surface), step + _ROOM * shape.size)
            if len(beside) or self.contact.near(name, x.poses, step):
                share = hop / step
        return share

    def centres(self, poses: Poses) -> Centres:
        """Centres of mass."""
        return {name: centre_of(collider.mass, poses[name]) for name, collider in self.free.items()}

    def weight(self, poses: Poses, gravity: Array) -> float:
        """Potential energy in gravity (dim,) [m/s^2], [J]."""
        centres = self.centres(poses)
        return -sum(float(self.free[name].mass.mass * gravity @ centre) for name, centre in centres.items())

    def kinetic(self, poses: Poses, motions: Mapping[str, RigidMotion]) -> float:
        """[J]."""
        return sum(motions[name].energy(collider.mass, poses[name]) for name, collider in self.free.items())

    def step(self, state: ReducedState, time_step: float, gravity: Array, friction: bool) -> FreeStep:
        """A step of time_step [s] that begins at a state; friction: whether there is any."""
        flights = {
            name: FreeFlight(collider.mass, state.poses[name], state.motions[name], time_step, gravity)
            for name, collider in self.free.items()
        }
        return FreeStep(self, flights, ColliderFriction(state.poses, time_step) if friction else None)


@dataclass(frozen=True, eq=False)
class FreeStep:
    """One step: how each collider would fly if nothing touched it, and what friction among colliders remembers."""

    movers: FreeBodies
    flights: Mapping[str, FreeFlight]
    friction: ColliderFriction | None

    def carried_on(self, poses: Poses, share: float = 1.0) -> Poses:
        """With the free colliders where their momenta alone would take them in a share of the step."""
        return {**poses, **{name: flight.carried_on(share) for name, flight in self.flights.items()}}

    def start(self, rows: Array, poses: Poses, energy: Callable[[Configuration], float]) -> Configuration:
        """Where Newton starts: the free colliders carried on, in hops that nothing is passed by in, for as long as the
        energy does not rise."""
        at, all_the_way = (Configuration(rows, self.carried_on(poses, share)) for share in (0.0, 1.0))
        far = np.concatenate([flight.step for flight in self.flights.values()])
        hops = int(np.ceil(1.0 / self.movers.longest(at, far)))
        if hops == 1:
            return all_the_way
        least = energy(at)
        for hop in range(1, hops + 1):
            ahead = Configuration(rows, self.carried_on(poses, hop / hops))
            found = energy(ahead)
            if found > least:
                break
            at, least = ahead, found
        return at

    def motions(self, poses: Poses) -> dict[str, RigidMotion]:
        """Of the free colliders, the step having ended at poses."""
        return {name: flight.motion_at(poses[name]) for name, flight in self.flights.items()}

    def inertia(self, poses: Poses) -> float:
        """Incremental [J]."""
        return sum(flight.energies(poses[name])[0] for name, flight in self.flights.items())

    def among(self, poses: Poses) -> tuple[float, float]:
        """Energy of contact and of friction among colliders [J]."""
        return self.movers.contact.energies(poses, self.friction)

    def longest(self, x: Configuration, v: Array) -> float:
        """The share of the unknowns v (n,) that can be gone at once."""
        return self.movers.longest(x, v * self.movers.units)

    @cached_property
    def _floor(self) -> float:
        """Forces below it are nothing [N]."""
        sizes = ((flight.inert, self.movers.size_of(name)) for name, flight in self.flights.items())
        return _NEGLIGIBLE_SHIFT * max(inert * size for inert, size in sizes)

    def energy(self, poses: Poses) -> float:
        """All but what body and colliders do to each other [J]."""
        flying = sum(sum(flight.energies(poses[name])) for name, flight in self.flights.items())
        return flying + sum(self.among(poses))

    def joined(
        self,
        body: Linearisation,
        poses: Poses,
        couplings: Sequence[Coupling],
        links: Sequence[Link],
        tangent: Array,
        relag: bool,
        timings: Timings,
    ) -> Linearisation:
        """By all unknowns, the body's first. body: what the handles feel; couplings: what body and free colliders feel
        of each other; links: and free colliders of one another, through it; tangent: d rows / d unknowns of the body;
        relag: let friction take up the forces found here."""
        movers = self.movers
        units, n, energy = movers.units, movers.size, 0.0
        flying, touching, hessian = np.zeros(n), np.zeros(n), np.zeros((n, n))
        with timings.contact:
            for name, flight in self.flights.items():
                at = movers.slot(name)
                energy += sum(flight.energies(poses[name]))
                flying[at], hessian[at, at] = flight.linearise(poses[name])
            for pair in movers.contact.linearise(poses, movers.centres(poses), self.friction, relag):
                energy += pair.energy
                for name, slope in pair.gradients(movers.free):
                    touching[movers.slot(name)] += slope
                for one, other, block in pair.blocks(movers.free):
                    hessian[movers.slot(one), movers.slot(other)] += block
            for coupling in couplings:
                touching[movers.slot(coupling.name)] += coupling.gradient
        flying, touching = units * flying, units * touching

        def joint() -> Array:
            own = body.hessian
            m = len(own)
            mixed, twisted = np.zeros((len(tangent), n)), hessian.copy()
            with timings.contact:
                for coupling in couplings:
                    at = movers.slot(coupling.name)
                    by_both, by_twist = coupling.blocks()
                    mixed[:, at] += by_both
                    twisted[at, at] += by_twist
                for first, second, block in links:
                    one, other, linked = movers.slot(first), movers.slot(second), block()
                    twisted[one, other] += linked
                    twisted[other, one] += linked.T
            full = np.empty((m + n, m + n))
            full[:m, :m] = own
            full[:m, m:] = (tangent.T @ mixed) * units
            full[m:, :m] = full[:m, m:].T
            full[m:, m:] = units[:, None] * twisted * units
            return full

        return Linearisation(
            energy=body.energy + energy,
            noise=body.noise + _ROUND_OFF * abs(energy),
            gradient=np.concatenate([body.gradient, flying + touching]),
            second_derivative=joint,
            scale=max(
                body.scale, self._floor, float(np.linalg.norm(flying)), float(np.linalg.norm(touching))
            ),
        )
