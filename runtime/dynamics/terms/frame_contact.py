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

import numpy as np

from softprint.runtime.arrays import Array
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
        spacing = body.mesh.surface_spacing / max(law.refinement, 1)
        self.frames = [FramePoints.of(body, frame, spacing) for frame in body.handles.frames]
        self.colliders, self.law, self.surface = colliders, law, body.mesh.surface_nodes

    def at(self, rows: Array, poses: Poses) -> FrameContactEvaluation:
        """At handle rows (n_rows, dim), with the colliders at poses."""
        return FrameContactEvaluation(self, rows, poses)


@dataclass(frozen=True, eq=False)
class _Touched:
    """A frame that a collider touches. x: (n, dim) [m] its points."""

    name: str
    frame: FramePoints
    x: Array
    terms: ContactTerms

    def motion(self, n_rows: int) -> Array:
        """dx/drows (m, dim, n_rows*dim) of the points in contact."""
        m, dim = self.terms.gradient.shape
        motion = np.zeros((m, dim, n_rows, dim))
        for axis in range(dim):
            motion[:, axis, self.frame.rows, axis] = self.frame.rest[self.terms.index]
        return motion.reshape(m, dim, -1)


@dataclass(frozen=True, eq=False)
class FrameContactEvaluation:
    """The contact of frames at one state."""

    contact: FrameContact
    rows: Array
    poses: Poses

    @lazy
    def touched(self) -> list[_Touched]:
        """Every frame with every collider that it touches."""
        return [touched for name in self.contact.colliders for touched in self._touched_by(name)]

    def _touched_by(self, name: str) -> list[_Touched]:
        frames, collider, pose = self.contact.frames, self.contact.colliders[name], self.poses[name]
        centres = np.array([frame.centre(self.rows) for frame in frames])
        radius = max(frame.radius for frame in frames)
        near, _, distance = collider.closer_to(centres, pose, radius)
        found = []
        for number in near[distance < np.array([frame.radius for frame in frames])[near]]:
            x = frames[number].positions(self.rows)
            areas = np.full(len(x), frames[number].area)
            terms = self.contact.law.terms(x, areas, collider, pose)
            if len(terms.index):
                found.append(_Touched(name, frames[number], x, terms))
        return found

    @property
    def energy(self) -> float:
        """[J]"""
        return sum(touched.terms.energy for touched in self.touched)

    def linearise(self, centres: Centres) -> tuple[Array, Array | None, list[Coupling]]:
        """Gradient (n_rows, dim) [N] and Hessian (n_rows*dim, n_rows*dim) [N/m] by the rows, no Hessian without
        contact; and the couplings with the colliders that move freely, about their centres."""
        n_rows, dim = self.rows.shape
        gradient = np.zeros_like(self.rows)
        hessian = np.zeros((n_rows, dim, n_rows, dim)) if self.touched else None
        couplings = []
        for touched in self.touched:
            terms, rows = touched.terms, touched.frame.rows
            basis = touched.frame.rest[terms.index]
            slope, curvature = through_basis(basis, terms.gradient, terms.hessian)
            gradient[rows] += slope
            assert hessian is not None
            hessian[rows, :, rows] += curvature.reshape(dim + 1, dim, dim + 1, dim)
            if touched.name in centres:
                arms, motion = touched.x[terms.index] - centres[touched.name], touched.motion(n_rows)
                couplings.append(point_coupling(touched.name, arms, terms.gradient, terms.hessian, motion))
        size = n_rows * dim
        return gradient, None if hessian is None else hessian.reshape(size, size), couplings

    def added_to(self, forces: Mapping[str, ContactForce]) -> dict[str, ContactForce]:
        """The forces of a contact on the colliders with these added. In the parts a frame's force is where the surface
        is nearest to it."""
        result = dict(forces)
        for touched in self.touched:
            name, terms = touched.name, touched.terms
            before, x = result[name], touched.x[terms.index]
            own = SurfaceForces(self.contact.surface, touched.frame.surface[terms.index], x, terms.gradient)
            parts = [*before.parts, own]
            total = resultant(parts, self.poses[name].translation)
            depth = max(before.penetration, float(terms.depth.max()))
            result[name] = ContactForce(*total, depth, before.points + len(x), parts)
        return result
