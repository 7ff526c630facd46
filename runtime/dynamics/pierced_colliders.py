"""Colliders that have pierced the body: a step that ends with one has the status PIERCED.

A collider that is moved along a path goes where the path leads. One that moves freely is held at the surface: a step
takes no iterate in which it is deeper in the body than the limit, or than it was at the start.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.contact_force import ContactForce
from softprint.runtime.contact.piercing import Piercing, PiercingSearch
from softprint.runtime.dynamics.deformed_surface import BodySurface, CondensedSurface, SampledSurface
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.dynamics.terms.surface_contact import SurfaceContactEnergy
from softprint.runtime.optimise import Status

# A step in which colliders move farther than the limit is checked at so many poses in between, at most.
_POSES_BETWEEN = 32


class PiercedColliders:
    """Finds the colliders of a scene that have pierced the body."""

    def __init__(
        self,
        body: ReducedBody,
        colliders: Mapping[str, Collider],
        condensed: CondensedContact | None,
        penalty: SurfaceContactEnergy,
    ) -> None:
        """condensed: contact with some of the colliders; penalty: with the others."""
        area, by_force = body.surface.areas.sum(), {} if condensed is None else condensed.searches
        parts: list[tuple[BodySurface, dict[str, Collider]]] = []
        if condensed is not None:
            parts.append((CondensedSurface(body, condensed), {name: colliders[name] for name in by_force}))
        others = {name: shape for name, shape in colliders.items() if name not in by_force}
        if others:
            parts.append((SampledSurface(penalty), others))
        spacings = [float(area / surface.n_nodes) ** (1.0 / (body.dim - 1)) for surface, _ in parts]
        self._parts = [
            (surface, PiercingSearch(own, spacing))
            for (surface, own), spacing in zip(parts, spacings, strict=True)
        ]

    @property
    def depth(self) -> float:
        """The depth [m] from which on every collider counts as piercing."""
        return max((search.limit for _, search in self._parts), default=np.inf)

    def found(self, body: BodyEvaluation, poses: Poses, names: Sequence[str] = ()) -> dict[str, Piercing]:
        """The colliders at poses that have pierced the body; names: of those that are asked for, all by default."""
        result: dict[str, Piercing] = {}
        for surface, search in self._parts:
            mine = [name for name in search.names if not names or name in names]
            if mine:
                result |= search.found(surface.at(body), {name: poses[name] for name in mine})
        return result

    def deepest(
        self, begin: BodyEvaluation, end: BodyEvaluation, released: Container[str]
    ) -> Piercing | None:
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

    def limit(self, begin: BodyEvaluation, names: Sequence[str]) -> FreeColliderLimit:
        """The limit for the free colliders with these names, in a step from a state."""
        return FreeColliderLimit(self, names, self.found(begin, begin.at.poses, names))

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
class FreeColliderLimit:
    """Refuses the iterates of one step in which a free collider has pierced the body deeper than at the start. refused:
    the last piercing that an iterate was refused for."""

    colliders: PiercedColliders
    names: Sequence[str]
    begin: Mapping[str, Piercing]
    refused: Piercing | None = field(default=None)

    def allows(self, body: BodyEvaluation) -> bool:
        """Whether the free colliders are no deeper than allowed."""
        for name, piercing in self.colliders.found(body, body.at.poses, self.names).items():
            if name not in self.begin or piercing.depth > self.begin[name].depth:
                self.refused = piercing
                return False
        return True


def with_piercing(result: StepResult[ReducedState], piercing: Piercing | None) -> StepResult[ReducedState]:
    """The result, with the status PIERCED where a collider has pierced the body."""
    if piercing is None:
        return result
    reason = f"{piercing.sentence}. {Status.PIERCED.sentence}"
    return replace(result, status=Status.PIERCED, reason=reason, piercing=piercing)


def _strongest(contact: ContactForce) -> Array:
    """Where the largest of the point forces acts (dim,) [m]."""
    part = contact.parts[0]
    return np.asarray(part.points[np.argmax(np.square(part.forces).sum(axis=1))])


def _depth(piercing: Piercing) -> float:
    return piercing.depth
