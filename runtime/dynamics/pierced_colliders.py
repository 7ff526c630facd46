"""Colliders that have pierced the body: a step that ends with one has the status PIERCED.

A collider that is moved along a path goes where the path leads. One that moves freely is held at the surface: a step
takes no iterate in which it has pierced the body, or is farther from the contact points of the body than these may be
stretched apart, unless it was as deep and as far at the start.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.contact_force import ContactForce
from softprint.runtime.contact.piercing import DeformedSurface, Piercing, PiercingSearch
from softprint.runtime.dynamics.state import Configuration, State, StepResult
from softprint.runtime.optimise import Status

# A step in which colliders move farther than the limit is checked at so many poses in between, at most.
_POSES_BETWEEN = 32
# A collider that is held, and has not pierced the body, may go farther by this factor in a step. The body settles about
# it meanwhile, and without that allowance no iterate of the step in which it comes out again is taken: it stays there.
_CREEP = 1.02


class Evaluated(Protocol):
    """A body evaluated at a configuration."""

    @property
    def at(self) -> Configuration: ...


Evaluation = TypeVar("Evaluation", bound=Evaluated)
_Evaluation = TypeVar("_Evaluation", bound=Evaluated, contravariant=True)


class BodySurface(Protocol[_Evaluation]):
    """Points of the surface of a body."""

    def at(self, body: _Evaluation, /) -> DeformedSurface:
        """At a state."""
        ...


class SearchedSurface(NamedTuple, Generic[Evaluation]):
    """A surface whose contact points are `spacing` [m] apart, between nodes that are `node_spacing` [m] apart, and the
    colliders that are searched in it, by name."""

    surface: BodySurface[Evaluation]
    colliders: Mapping[str, Collider]
    spacing: float
    node_spacing: float


class PiercedColliders(Generic[Evaluation]):
    """Finds the colliders of a scene that have pierced the body."""

    def __init__(self, parts: Sequence[SearchedSurface[Evaluation]]) -> None:
        self._parts = [
            (part.surface, PiercingSearch(part.colliders, part.spacing, part.node_spacing)) for part in parts
        ]

    @property
    def depth(self) -> float:
        """The depth [m] from which on every collider counts as piercing."""
        return max((search.limit for _, search in self._parts), default=np.inf)

    def found(self, body: Evaluation, poses: Poses, names: Sequence[str] = ()) -> dict[str, Piercing]:
        """The colliders at poses that have pierced the body; names: of those that are asked for, all by default."""
        result: dict[str, Piercing] = {}
        for search, surface, mine in self._asked(body, poses, names):
            result |= search.found(surface, mine)
        return result

    def too_far(self, body: Evaluation, poses: Poses, names: Sequence[str]) -> dict[str, Piercing]:
        """The free colliders with these names that a step must not leave at these poses."""
        result: dict[str, Piercing] = {}
        for search, surface, mine in self._asked(body, poses, names):
            result |= search.too_far(surface, mine)
        return result

    def _asked(
        self, body: Evaluation, poses: Poses, names: Sequence[str]
    ) -> Iterator[tuple[PiercingSearch, DeformedSurface, Poses]]:
        for surface, search in self._parts:
            mine = {name: poses[name] for name in search.names if not names or name in names}
            if mine:
                yield search, surface.at(body), mine

    def deepest(self, begin: Evaluation, end: Evaluation, released: Container[str]) -> Piercing | None:
        """The deepest collider that has pierced the body at the end of a step; None where none has. Those that do not
        touch the body then, `released`, may have passed through it: in between they lay inside the body both as it was
        and as it is."""
        pierced = list(self.found(end, end.at.poses).values())
        for poses in self._between(begin.at.poses, end.at.poses, released):
            before = self.found(begin, poses, list(poses))
            if before:
                after = self.found(end, poses, list(before))
                pierced += [min(before[name], after[name], key=_depth) for name in after]
        return max(pierced, key=_depth, default=None)

    def penetrating(self, contacts: Mapping[str, ContactForce]) -> Piercing | None:
        """The collider in which points of the body are deepest, where this is deeper than the limit, so that a crushed
        body counts as pierced too; None where none is. Colliders without bounds do not count."""
        found = [
            Piercing(name, contacts[name].penetration, _strongest(contacts[name]))
            for _, search in self._parts
            for name in search.bounded
            if name in contacts and contacts[name].penetration > search.limit
        ]
        return max(found, key=_depth, default=None)

    def limit(self, begin: Evaluation, names: Sequence[str]) -> FreeColliderLimit[Evaluation]:
        """The limit for the free colliders with these names, in a step from a state."""
        return FreeColliderLimit.of(self, begin, names)

    def _between(self, before: Poses, after: Poses, names: Container[str]) -> Iterator[Poses]:
        """Poses of some colliders in the course of a step, none where they move by less than the limit."""
        for _, search in self._parts:
            hops = {
                name: search.hops(name, before[name], after[name]) for name in search.names if name in names
            }
            count = min(max(hops.values(), default=1), _POSES_BETWEEN)
            for number in range(1, count):
                yield {name: before[name].towards(after[name], number / count) for name in hops}


@dataclass(eq=False)
class FreeColliderLimit(Generic[Evaluation]):
    """Refuses the iterates of one step in which a free collider has pierced the body, or goes too far. pierced, far:
    how deep and how far [m] those may be that are so at the start; refused: the last that an iterate was refused
    for."""

    colliders: PiercedColliders[Evaluation]
    names: Sequence[str]
    pierced: Mapping[str, float]
    far: Mapping[str, float]
    refused: Piercing | None = field(default=None)

    @classmethod
    def of(
        cls, colliders: PiercedColliders[Evaluation], begin: Evaluation, names: Sequence[str]
    ) -> FreeColliderLimit[Evaluation]:
        """For a step from a state."""
        poses = begin.at.poses
        pierced = {name: own.depth for name, own in colliders.found(begin, poses, names).items()}
        far = {
            name: own.depth * (1.0 if name in pierced else _CREEP)
            for name, own in colliders.too_far(begin, poses, names).items()
        }
        return cls(colliders, names, pierced, far)

    def allows(self, body: Evaluation) -> bool:
        """Whether the free colliders are no deeper and no farther than allowed."""
        poses = body.at.poses
        for found, at_most in (
            (self.colliders.too_far(body, poses, self.names), self.far),
            (self.colliders.found(body, poses, self.names), self.pierced),
        ):
            for name, piercing in found.items():
                if piercing.depth > at_most.get(name, 0.0):
                    self.refused = replace(piercing, refused=True)
                    return False
        return True


def with_piercing(result: StepResult[State], piercing: Piercing | None) -> StepResult[State]:
    """The result, with the status PIERCED where a collider has pierced the body."""
    if piercing is None:
        return result
    reason = f"{piercing.sentence}. {Status.PIERCED.sentence}"
    return replace(result, status=Status.PIERCED, reason=reason, piercing=piercing)


def _strongest(contact: ContactForce) -> Array:
    """Where the largest of the point forces acts (dim,) [m]."""
    points, forces = (
        np.concatenate([getattr(part, of) for part in contact.parts]) for of in ("points", "forces")
    )
    return np.asarray(points[np.argmax(np.square(forces).sum(axis=1))])


def _depth(piercing: Piercing) -> float:
    return piercing.depth
