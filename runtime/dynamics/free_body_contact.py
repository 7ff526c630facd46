"""Contact of freely moving colliders with all other colliders, moving or not.

The surface points of a free collider (`runtime/rigid/free_collider.py`) feel the penalty and the friction of every
other collider as the surface of a soft body does (`runtime/contact`). Where both move freely, the points of each feel
the other, and each side counts for half. Gradient and Hessian by both twists are exact: points at arms a from the
centre of their own collider move by (I, E_k a), and what a twist of the other collider makes of them is in
`runtime/rigid/twist.py`.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Array
from runtime.colliders.collider import Collider
from runtime.colliders.pose import Poses
from runtime.contact import ContactTerms, CoulombFriction, FrictionTerms, LaggedContact, PenaltyContact
from runtime.contact.collider_coupling import Centres
from runtime.rigid import kernels
from runtime.rigid.free_collider import FreeCollider
from runtime.rigid.twist import felt_by_the_other

# Two rigid surfaces press each other so many times as stiffly as one presses a soft body: depths are a fifth of those,
# and what it takes to be driven through a plate is a hundred times as much.
_RIGID = 100.0

Pair = tuple[str, str]


@dataclass
class ColliderFriction:
    """What friction remembers within a step of time_step [s] that began at poses: by pair, what it holds fixed."""

    poses: Poses
    time_step: float
    lagged: dict[Pair, LaggedContact] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class TouchingPair:
    """Points of the collider `first` in the collider `second`: energy [J], gradients by their twists (n_twist,), and
    the three second derivatives (n_twist, n_twist)."""

    first: str
    second: str
    energy: float
    by_first: Array
    by_second: Array
    first_first: Array
    first_second: Array
    second_second: Array

    def gradients(self, free: Container[str]) -> Iterator[tuple[str, Array]]:
        """By the twists of the colliders that move freely."""
        yield self.first, self.by_first
        if self.second in free:
            yield self.second, self.by_second

    def blocks(self, free: Container[str]) -> Iterator[tuple[str, str, Array]]:
        """Of the joint Hessian of the colliders that move freely."""
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
        """Colliders that may touch: the points (p, dim) of the first in the world, and their areas (p,)."""
        for first, body in self._free.items():
            for second in self._shapes:
                if second == first or not self._close(first, second, poses, 0.0):
                    continue
                share = 0.5 if second in self._free else 1.0
                yield (first, second), poses[first].apply(body.points), share * body.areas

    def _close(self, first: str, second: str, poses: Poses, room: float) -> bool:
        """Whether a ball about the first, and room [m] more, reaches the second."""
        shape, reach = self._shapes[second], self._reach[first] + room
        centre, at = poses[first].translation, poses[second]
        if second in self._unbounded:
            return bool(shape.sdf(at.apply_inverse(centre[None]))[0] < reach)
        return kernels.ball_meets(at.rotation, at.translation, shape.lower, shape.upper, centre, reach)

    def near(self, name: str, poses: Poses, room: float) -> bool:
        """Whether a collider that moves freely could meet another within room [m]."""
        return any(self._close(name, other, poses, room) for other in self._shapes if other != name)

    def energies(self, poses: Poses, friction: ColliderFriction | None) -> tuple[float, float]:
        """Of contact and of friction as it was last taken up [J]."""
        normal, sliding = 0.0, 0.0
        for pair, x, areas in self._pairs(poses):
            normal += self._contact.energy(x, areas, self._shapes[pair[1]], poses[pair[1]])
            if self._rubs(pair, friction):
                sliding += self._rubbing(pair, x, poses, friction).energy
        return normal, sliding

    def linearise(
        self, poses: Poses, centres: Centres, friction: ColliderFriction | None, relag: bool
    ) -> Iterator[TouchingPair]:
        """Every pair that touches."""
        for pair, x, areas in self._pairs(poses):
            terms = self._terms(pair, x, areas, poses, friction, relag)
            if any(len(term.index) for term in terms):
                yield self._touching(pair, x, terms, centres)

    def _terms(
        self, pair: Pair, x: Array, areas: Array, poses: Poses, friction: ColliderFriction | None, relag: bool
    ) -> list[ContactTerms | FrictionTerms]:
        first, second = pair
        contact = self._contact.terms(x, areas, self._shapes[second], poses[second])
        if self._friction is None or friction is None:
            return [contact]
        if relag:
            start = friction.poses[first].apply(self._free[first].points)
            friction.lagged[pair] = self._friction.lag(contact, start, friction.poses[second], poses[second])
        return [contact, self._rubbing(pair, x, poses, friction)] if self._rubs(pair, friction) else [contact]

    def _rubs(self, pair: Pair, friction: ColliderFriction | None) -> bool:
        """Whether friction has taken up any force of the pair."""
        return friction is not None and pair in friction.lagged and len(friction.lagged[pair].index) > 0

    def _rubbing(
        self, pair: Pair, x: Array, poses: Poses, friction: ColliderFriction | None
    ) -> FrictionTerms:
        assert self._friction is not None
        assert friction is not None
        return self._friction.terms(x, friction.lagged[pair].at(poses[pair[1]]), friction.time_step)

    def _touching(
        self, pair: Pair, x: Array, terms: list[ContactTerms | FrictionTerms], centres: Centres
    ) -> TouchingPair:
        first, second = pair
        index = np.concatenate([term.index for term in terms])
        gradient = np.concatenate([term.gradient for term in terms])
        hessian = np.concatenate([term.hessian for term in terms])
        arms = x[index] - centres[first]
        by_first, first_first = kernels.of_its_points(arms, gradient, hessian)
        # A collider that does not move freely has no twist; whichever centre it is told of, nothing is made of it.
        by_second, pushed, second_second = felt_by_the_other(
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
