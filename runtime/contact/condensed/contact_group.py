"""The points of a body that are solved for together, in contact with one collider or with several."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.contact.condensed.all_points import AllPoints
from softprint.runtime.contact.condensed.near_colliders import NearColliders
from softprint.runtime.contact.solver.candidates import Candidates, PointDistance
from softprint.runtime.contact.solver.contact_point_kernels import are_among
from softprint.runtime.contact.solver.contact_points import CorotatedPoints
from softprint.runtime.contact.solver.contact_solve import ContactProblem
from softprint.runtime.contact.solver.pressed_points import PressedPoints
from softprint.runtime.lazy import lazy


@dataclass(frozen=True, eq=False)
class ContactGroup:
    """colliders: all that the body may touch; together: all contact points, with those that sharp points press; near:
    the candidates on the facets, by collider; candidates: these and those that sharp points of the same colliders
    press; distance: of all candidates."""

    colliders: NearColliders
    together: AllPoints
    near: Mapping[str, Candidates]
    candidates: Candidates
    distance: PointDistance

    @classmethod
    def of(
        cls, colliders: NearColliders, together: AllPoints, near: Mapping[str, Candidates], bore: IntArray
    ) -> ContactGroup | None:
        """None where nothing is inside. Colliders of which only sharp points touch are added to those near. bore: (m,),
        ascending, the points that bore pressure in the last contact, or are known to be pushed in: sharp points that
        press these still may."""
        pressed = together.pressed
        if pressed is None:
            if not near:
                return None
            candidates, owner = colliders.merged(near)
            return cls(colliders, together, near, candidates, _distance(colliders, near, owner))
        names, near = list(colliders.searches), dict(near)
        x, distance = _of_sharp_points(colliders, together, pressed)
        bearing = are_among(pressed.index, bore)
        for number in sorted(set(pressed.collider[bearing | (distance < 0.0)].tolist())):
            near.setdefault(names[number], Candidates.none(x.shape[1]))
        if not near:
            return None
        candidates, owner = colliders.merged(near)
        number = np.array([list(near).index(name) if name in near else -1 for name in names])
        mine = np.flatnonzero(number[pressed.collider] >= 0)
        candidates = candidates.followed_by(pressed.index[mine], distance[mine], x[mine], bearing[mine])
        if not candidates.may_be_active.any():
            return None
        owner = np.concatenate([owner, number[pressed.collider[mine]]])
        planes = pressed.planes(mine) if len(mine) else None
        found = replace(_distance(colliders, near, owner), planes=planes)
        return cls(colliders, together, near, candidates, found)

    @lazy
    def every(self) -> CorotatedPoints:
        """All contact points, in the frame of the step."""
        return self.together.in_frame(self.colliders.points)

    @lazy
    def index(self) -> IntArray:
        """(m,) the points that may be active."""
        return self.candidates.index[self.candidates.may_be_active]

    @lazy
    def among(self) -> PointDistance:
        """The distance of these."""
        return self.distance.among(self.candidates.may_be_active)

    def problem(self, tight: bool) -> ContactProblem:
        """The contact problem of these; tight: see `ContactProblem`."""
        return ContactProblem(
            self.together.compliance.among(self.index),
            self.every.carriers(self.colliders.rows, self.index),
            self.together.stiffness[self.index],
            self.candidates.position[self.candidates.may_be_active],
            self.candidates.depth,
            self.among,
            tight,
        )

    def with_possibly_active(self, more: BoolArray) -> ContactGroup:
        """With more of the candidates (n,) that may be active."""
        return replace(self, candidates=self.candidates.with_possibly_active(more))

    def with_further(self, facets: Mapping[str, Candidates], pressed: IntArray) -> ContactGroup:
        """With the candidates on facets of further colliders, by name, and points (k,) that sharp points of these
        press. What may be active still may."""
        bearing = np.union1d(self.index, pressed)
        found = ContactGroup.of(self.colliders, self.together, {**self.near, **facets}, bearing)
        assert found is not None  # since it has those of this group
        return found.with_possibly_active(are_among(found.candidates.index, self.index))


def _of_sharp_points(
    colliders: NearColliders, together: AllPoints, pressed: PressedPoints
) -> tuple[Array, Array]:
    """Positions x (k, dim) [m] of the points that sharp points press, without contact displacement, and their signed
    distances (k,) [m]."""
    x = together.in_frame(colliders.points).positions(colliders.rows, pressed.index)
    at = [colliders.poses[name] for name in colliders.searches]
    return x, pressed.planes(slice(None)).placed(pressed.collider, at).value(x)


def _distance(colliders: NearColliders, near: Mapping[str, Candidates], owner: IntArray) -> PointDistance:
    return PointDistance(tuple(near), tuple(map(colliders.posed, near)), owner)
