"""The deformed surface of a reduced body, displaced by contact, at a cost that does not grow with the mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.piercing import DeformedSurface
from softprint.runtime.contact.solver.contact_points import ContactPoints
from softprint.runtime.dynamics.pierced_colliders import PiercedColliders, SearchedSurface
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.dynamics.terms.surface_contact import SurfaceContactEnergy
from softprint.runtime.elasticity.invariants import cofactor
from softprint.runtime.linalg.row_products import placed


def reduced_search(
    body: ReducedBody,
    colliders: Mapping[str, Collider],
    condensed: CondensedContact | None,
    penalty: SurfaceContactEnergy,
) -> PiercedColliders[BodyEvaluation]:
    """The search for colliders, by name, that have pierced a reduced body. condensed: contact with some of them;
    penalty: with the others."""
    area, by_force = body.surface.areas.sum(), {} if condensed is None else condensed.searches
    surfaces: list[tuple[CondensedSurface | SampledSurface, dict[str, Collider]]] = []
    if condensed is not None:
        surfaces.append((CondensedSurface(body, condensed), {name: colliders[name] for name in by_force}))
    others = {name: shape for name, shape in colliders.items() if name not in by_force}
    if others:
        surfaces.append((SampledSurface(penalty), others))
    return PiercedColliders(
        [
            SearchedSurface(surface, own, float(area / len(surface)) ** (1.0 / (body.dim - 1)))
            for surface, own in surfaces
        ]
    )


class SampledSurface:
    """The points of penalty contact."""

    def __init__(self, contact: SurfaceContactEnergy) -> None:
        self.points = ContactPoints(contact.material, None)

    def __len__(self) -> int:
        return len(self.points.material)

    def at(self, body: BodyEvaluation) -> DeformedSurface:
        """See `BodySurface`."""
        return _SampledAt(self.points, body.at.rows, body.positions)


@dataclass(frozen=True, eq=False)
class _SampledAt:
    """approximate: exact in fact."""

    points: ContactPoints
    rows: Array
    approximate: Array

    def positions(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return np.asarray(self.approximate[index])

    def normals(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return _normals(self.points, self.rows, index)


class CondensedSurface:
    """The points of condensed contact, which lie outside rigid frames, and the surface samples in rigid frames."""

    def __init__(self, body: ReducedBody, condensed: CondensedContact) -> None:
        own, samples = condensed.points.material, body.surface.nodes
        rigid = body.node_points(samples[np.isin(samples, body.handles.frame_nodes)])
        self.n_contact = len(own)
        self.points = ContactPoints(own.followed_by(rigid), None)

    def __len__(self) -> int:
        return len(self.points.material)

    def at(self, body: BodyEvaluation) -> DeformedSurface:
        """See `BodySurface`."""
        contact, rows = body.contact, body.at.rows
        assert contact is not None  # there is condensed contact, so that every evaluation has one
        rigid = placed(self.points.material.basis[self.n_contact :], rows)
        approximate = np.concatenate([contact.points.bounded_positions(rows)[0], rigid])
        return _CondensedAt(self.points, self.n_contact, contact, approximate)


@dataclass(frozen=True, eq=False)
class _CondensedAt:
    points: ContactPoints
    n_contact: int
    contact: ContactEvaluation
    approximate: Array

    def positions(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        first = np.searchsorted(index, self.n_contact)
        own, rigid = index[:first], self.approximate[index[first:]]
        return np.concatenate([self.contact.deformed_positions(own), rigid])

    def normals(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return _normals(self.points, self.contact.rows, index)


def _normals(points: ContactPoints, rows: Array, index: IntArray) -> Array:
    """cof(F) N (m, dim): the deformed surface normals, without the displacement by contact."""
    normal = points.material.surface_normal[index]
    return np.asarray((cofactor(points.deformation(rows, index)) @ normal[..., None])[..., 0])
