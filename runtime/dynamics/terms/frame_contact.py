"""Contact of the rigid frames of a body with colliders, beside condensed contact.

In condensed contact the flesh gives way linearly, as much as a force asks for. A bone is as far below the surface as
the flesh over it is thick, and does not give way: without contact of its own a collider that is pressed on goes through
it. So it is where a frame is part of the surface, which has no compliance there. This is penalty contact
(`runtime/contact/penalty.py`) at points of the frames (`runtime/contact/frame_points.py`), which the handle rows of
their frame alone move, x = X R^T + t. It is without friction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.collider_coupling import Centres, Coupling, point_coupling
from softprint.runtime.contact.contact_force import ContactForce, SurfaceForces, resultant
from softprint.runtime.contact.frame_points import FramePoints
from softprint.runtime.contact.penalty import ContactTerms, PenaltyContact
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.chain_rule import through_basis


class FrameContact:
    """The frames of a body and the colliders, by name, that press it by condensed contact."""

    def __init__(self, body: ReducedBody, colliders: Mapping[str, Collider], law: PenaltyContact) -> None:
        mesh = body.mesh
        self.points = FramePoints.of(
            body, law.sharp_spacing(mesh) if law.refinement else mesh.surface_spacing
        )
        self.colliders, self.law, self.surface = colliders, law, body.mesh.surface_nodes

    def at(self, rows: Array, poses: Poses) -> FrameContactEvaluation:
        """At handle rows (n_rows, dim), with the colliders at poses."""
        return FrameContactEvaluation(self, rows, poses)


class _Touched(NamedTuple):
    """m points that a collider touches: their numbers, positions (m, dim) [m], and contact."""

    numbers: IntArray
    x: Array
    terms: ContactTerms


@dataclass(frozen=True, eq=False)
class FrameContactEvaluation:
    """The contact of frames at one state."""

    contact: FrameContact
    rows: Array
    poses: Poses

    @lazy
    def touched(self) -> dict[str, _Touched]:
        """By collider, of those that touch a frame."""
        found = ((name, self._touched_by(name)) for name in self.contact.colliders)
        return {name: touched for name, touched in found if touched is not None}

    def _touched_by(self, name: str) -> _Touched | None:
        points, collider, pose = self.contact.points, self.contact.colliders[name], self.poses[name]
        near = points.near(self.rows, collider, pose)
        if not len(near):
            return None
        x = points.positions(self.rows, near)
        terms = self.contact.law.terms(x, points.areas[near], collider, pose)
        at = terms.index
        return _Touched(near[at], x[at], terms) if len(at) else None

    @property
    def energy(self) -> float:
        """[J]"""
        return sum(touched.terms.energy for touched in self.touched.values())

    def linearise(self, centres: Centres) -> tuple[Array, Array | None, list[Coupling]]:
        """Gradient (n_rows, dim) [N] and Hessian (n_rows*dim, n_rows*dim) [N/m] by the rows, no Hessian without
        contact; and the couplings with the colliders that move freely, about their centres."""
        gradient, hessian, couplings = np.zeros_like(self.rows), None, list[Coupling]()
        for name, (index, x, terms) in self.touched.items():
            basis = self.contact.points.basis(index, len(self.rows))
            slope, curvature = through_basis(basis, terms.gradient, terms.hessian)
            gradient, hessian = gradient + slope, curvature if hessian is None else hessian + curvature
            if name in centres:
                motion = np.einsum("mr,ik->mirk", basis, np.eye(x.shape[1])).reshape(*x.shape, -1)
                arms = x - centres[name]
                couplings.append(point_coupling(name, arms, terms.gradient, terms.hessian, motion))
        return gradient, hessian, couplings

    def added_to(self, forces: Mapping[str, ContactForce]) -> dict[str, ContactForce]:
        """The forces of a contact on the colliders with these added. In the parts a frame's force is where the surface
        is nearest to it."""
        result = dict(forces)
        for name, (index, x, terms) in self.touched.items():
            before = result[name]
            own = SurfaceForces(self.contact.surface, self.contact.points.surface[index], x, terms.gradient)
            parts = [*before.parts, own]
            total = resultant(parts, self.poses[name].translation)
            depth = max(before.penetration, float(terms.depth.max()))
            result[name] = ContactForce(*total, depth, before.points + len(x), parts)
        return result
