"""Contact of freely moving colliders with all other colliders, moving or not.

Penalty and friction act on the surface points of a free collider (`runtime/rigid/free_collider.py`) in every other
collider, as on the surface of a soft body (`runtime/contact`). Where both move freely, the points of each are tested
against the other, and each side counts half. Gradient and Hessian by both twists are exact: points at arms a from the
centre of their own collider move by (I, E_k a); the derivatives by a twist of the other collider are in
`runtime/rigid/twist.py`.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact import (
    ContactTerms,
    CoulombFriction,
    FrictionTerms,
    LaggedContact,
    PenaltyContact,
)
from softprint.runtime.contact.collider_coupling import Centres
from softprint.runtime.contact.lagged_friction import LaggedFriction, SlipStart
from softprint.runtime.rigid import kernels
from softprint.runtime.rigid.free_collider import FreeCollider
from softprint.runtime.rigid.twist import touched_body_derivatives

# The contact stiffness between two rigid surfaces, relative to that with a soft body: penetration is about a fifth, and
# the force that drives a collider through a plate is a hundred times as large.
_RIGID = 100.0

Pair = tuple[str, str]


@dataclass(frozen=True, eq=False)
class TouchingPair:
    """Contact of points of the collider `first` with the collider `second`: energy [J], gradients by their twists
    (n_twist,), and the three second derivatives (n_twist, n_twist)."""

    first: str
    second: str
    energy: float
    by_first: Array
    by_second: Array
    first_first: Array
    first_second: Array
    second_second: Array

    def gradients(self, free: Container[str]) -> Iterator[tuple[str, Array]]:
        """The gradients by the twists of the colliders that move freely."""
        yield self.first, self.by_first
        if self.second in free:
            yield self.second, self.by_second

    def blocks(self, free: Container[str]) -> Iterator[tuple[str, str, Array]]:
        """The blocks of the joint Hessian of the colliders that move freely."""
        yield self.first, self.first, self.first_first
        if self.second in free:
            yield self.first, self.second, self.first_second
            yield self.second, self.first, self.first_second.T
            yield self.second, self.second, self.second_second


class ColliderContact:
    """free: colliders that move freely, with their points; shapes: all colliders of the scene; both by name."""

    def __init__(
        self,
        free: Mapping[str, FreeCollider],
        shapes: Mapping[str, Collider],
        contact: PenaltyContact,
        friction: CoulombFriction | None,
    ) -> None:
        self._free, self._shapes = free, shapes
        self._contact, self._friction = PenaltyContact(_RIGID * contact.stiffness), friction
        self._unbounded = {name for name, shape in shapes.items() if not np.isfinite(shape.upper).all()}
        self._reach = {name: float(np.linalg.norm(body.points, axis=1).max()) for name, body in free.items()}

    def _pairs(self, poses: Poses) -> Iterator[tuple[Pair, Array, Array]]:
        """Pairs of colliders that may touch; the points (p, dim) of the first in the world, and their areas (p,)."""
        for first, body in self._free.items():
            for second in self._shapes:
                if second == first or not self._close(first, second, poses, 0.0):
                    continue
                share = 0.5 if second in self._free else 1.0
                yield (first, second), poses[first].apply(body.points), share * body.areas

    def _close(self, first: str, second: str, poses: Poses, room: float) -> bool:
        """Whether the bounding ball of the first, enlarged by room [m], reaches the second."""
        shape, reach = self._shapes[second], self._reach[first] + room
        centre, at = poses[first].translation, poses[second]
        if second in self._unbounded:
            return bool(shape.sdf(at.apply_inverse(centre[None]))[0] < reach)
        return kernels.ball_meets(at.rotation, at.translation, shape.lower, shape.upper, centre, reach)

    def near(self, name: str, poses: Poses, room: float) -> bool:
        """Whether a free collider could touch another one within room [m]."""
        return any(self._close(name, other, poses, room) for other in self._shapes if other != name)

    def energies(self, poses: Poses, lagged: LaggedFriction | None) -> tuple[float, float]:
        """Energies of contact and of lagged friction [J]."""
        normal, sliding = 0.0, 0.0
        for pair, x, areas in self._pairs(poses):
            normal += self._contact.energy(x, areas, self._shapes[pair[1]], poses[pair[1]])
            friction = self._friction_of(pair, x, poses, lagged)
            sliding += 0.0 if friction is None else friction.energy
        return normal, sliding

    def lag(self, poses: Poses, start: SlipStart) -> dict[Pair, LaggedContact]:
        """The lagged friction of each pair that may touch."""
        if self._friction is None:
            return {}
        lagged = {}
        for pair, x, areas in self._pairs(poses):
            first, second = pair
            contact = self._contact.terms(x, areas, self._shapes[second], poses[second])
            before = start.poses[first].apply(self._free[first].points)
            lagged[pair] = self._friction.lag(contact, before, start.poses[second], poses[second])
        return lagged

    def linearise(
        self, poses: Poses, centres: Centres, lagged: LaggedFriction | None
    ) -> Iterator[TouchingPair]:
        """The derivatives of every pair in contact."""
        for pair, x, areas in self._pairs(poses):
            terms: list[ContactTerms | FrictionTerms] = [
                self._contact.terms(x, areas, self._shapes[pair[1]], poses[pair[1]])
            ]
            friction = self._friction_of(pair, x, poses, lagged)
            if friction is not None:
                terms.append(friction)
            if any(len(term.index) for term in terms):
                yield self._touching(pair, x, terms, centres)

    def _friction_of(
        self, pair: Pair, x: Array, poses: Poses, lagged: LaggedFriction | None
    ) -> FrictionTerms | None:
        """Friction of a pair; None without lagged normal forces."""
        if self._friction is None or lagged is None or pair not in lagged.bodies:
            return None
        contact = lagged.bodies[pair]
        if not len(contact.index):
            return None
        return self._friction.terms(x, contact.at(poses[pair[1]]), lagged.start.time_step)

    def _touching(
        self, pair: Pair, x: Array, terms: list[ContactTerms | FrictionTerms], centres: Centres
    ) -> TouchingPair:
        first, second = pair
        index = np.concatenate([term.index for term in terms])
        gradient = np.concatenate([term.gradient for term in terms])
        hessian = np.concatenate([term.hessian for term in terms])
        arms = x[index] - centres[first]
        by_first, first_first = kernels.own_body_derivatives(arms, gradient, hessian)
        # If the second collider does not move freely, the derivatives by its twist are not used: any centre will do.
        by_second, pushed, second_second = touched_body_derivatives(
            x[index] - centres.get(second, centres[first]), gradient, hessian
        )
        return TouchingPair(
            first,
            second,
            sum(term.energy for term in terms),
            by_first,
            by_second,
            first_first,
            kernels.between(arms, pushed),
            second_second,
        )
