"""The deformed surface of a reduced body, displaced by contact, at a cost that does not grow with the mesh: but where a
collider is far from the contact points inside, all facets near it are looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.piercing import DeformedSurface, depths_inside
from softprint.runtime.contact.solver.contact_points import ContactPoints
from softprint.runtime.contact.solver.contact_solve_kernels import to_world
from softprint.runtime.dynamics.pierced_colliders import PiercedColliders, SearchedSurface
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.dynamics.terms.surface_contact import SurfaceContactEnergy
from softprint.runtime.elasticity.invariants import cofactor
from softprint.runtime.linalg.row_products import placed, placed_some
from softprint.runtime.mechanics.loaded_points import owners
from softprint.runtime.mesh.nearest_facets import grouped_by_place


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
        surfaces.append((SampledSurface(body, penalty), others))

    def apart(count: int) -> float:
        return float(area / count) ** (1.0 / (body.dim - 1))

    return PiercedColliders(
        [
            SearchedSurface(surface, own, apart(len(surface)), apart(surface.n_nodes))
            for surface, own in surfaces
        ]
    )


class _Facets:
    """The facets between the n nodes of the surface of a body, and the nearest of its contact points to each node.
    corners: (f, dim) numbers of the nodes, and groups: (f,) of neighbours, ascending; points: (n,); nodes: (n,) in the
    mesh."""

    def __init__(self, body: ReducedBody, points: Array) -> None:
        """points: (k, dim) [m] contact points at rest."""
        mesh = body.mesh
        self.nodes = mesh.surface_nodes
        order, self.groups = grouped_by_place(mesh.points[mesh.facets].mean(axis=1))
        self.corners = np.searchsorted(self.nodes, mesh.facets[order])
        self.basis = np.ascontiguousarray(body.basis[self.nodes])
        self.points = cKDTree(points).query(mesh.points[self.nodes])[1]

    def near(self, points: IntArray) -> IntArray:
        """The nodes (k,), ascending, whose contact point is one of some."""
        return np.flatnonzero(np.isin(self.points, points))

    def depths(self, z: Array, x: Array, nodes: IntArray, outer: BoolArray) -> Array:
        """`depths_inside` of points z (k, dim) with the nodes at x (n, dim) [m], from the facets between some of these
        (m,)."""
        return depths_inside(z, x, self.corners, nodes, outer, self.groups)

    def beside(self, points: ContactPoints, rows: Array, approximate: Array) -> Array:
        """(n, dim) [m]: every node displaced from handle rows (n_rows, dim) as its contact point is, of those at
        approximate positions."""
        return placed(self.basis, rows) + (approximate - placed(points.material.basis, rows))[self.points]


class SampledSurface:
    """The points of penalty contact."""

    def __init__(self, body: ReducedBody, contact: SurfaceContactEnergy) -> None:
        self.points = ContactPoints(contact.material, None)
        self.facets, self.n_nodes = _Facets(body, contact.material.rest), len(contact.nodes)

    def __len__(self) -> int:
        return len(self.points.material)

    def at(self, body: BodyEvaluation) -> DeformedSurface:
        """See `BodySurface`."""
        return _SampledAt(self.points, self.facets, body.at.rows, body.positions)


@dataclass(frozen=True, eq=False)
class _SampledAt:
    """approximate: exact in fact."""

    points: ContactPoints
    facets: _Facets
    rows: Array
    approximate: Array

    @property
    def known(self) -> Array:
        """See `DeformedSurface`: none, as all are looked at without delay."""
        return self.approximate[:0]

    def positions(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return np.asarray(self.approximate[index])

    def normals(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return _normals(self.points, self.rows, index)

    def depths(self, z: Array, near: IntArray, outer: BoolArray) -> Array:
        """See `DeformedSurface`."""
        x = self.facets.beside(self.points, self.rows, self.approximate)
        return self.facets.depths(z, x, self.facets.near(near), outer)


class CondensedSurface:
    """The points of condensed contact, which lie outside rigid frames, and the surface samples in rigid frames."""

    def __init__(self, body: ReducedBody, condensed: CondensedContact) -> None:
        own, samples = condensed.points.material, body.surface.nodes
        rigid = body.node_points(samples[np.isin(samples, body.handles.frame_nodes)])
        self.n_contact = len(own)
        self.points = ContactPoints(own.followed_by(rigid), None)
        self.facets = _Facets(body, self.points.material.rest)
        self.n_nodes = len(condensed.nodes) + len(rigid)
        self.owner = owners(body, condensed.nodes)[self.facets.nodes]
        self.compliance = condensed.of_nodes

    def __len__(self) -> int:
        return len(self.points.material)

    def at(self, body: BodyEvaluation) -> DeformedSurface:
        """See `BodySurface`."""
        contact, rows = body.contact, body.at.rows
        assert contact is not None  # there is condensed contact, so that every evaluation has one
        rigid = placed(self.points.material.basis[self.n_contact :], rows)
        approximate = np.concatenate([contact.points.bounded_positions(rows)[0], rigid])
        return _CondensedAt(self, contact, approximate)


@dataclass(frozen=True, eq=False)
class _CondensedAt:
    surface: CondensedSurface
    contact: ContactEvaluation
    approximate: Array

    @property
    def known(self) -> Array:
        """See `DeformedSurface`: those on facets that took part in the contact solve."""
        solved = self.contact.solved
        if solved is None:
            return self.approximate[:0]
        return np.asarray(solved.deformed_position[solved.index < self.surface.n_contact])

    def positions(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        first = np.searchsorted(index, self.surface.n_contact)
        own, rigid = index[:first], self.approximate[index[first:]]
        return np.concatenate([self.contact.deformed_positions(own), rigid])

    def normals(self, index: IntArray) -> Array:
        """See `DeformedSurface`."""
        return _normals(self.surface.points, self.contact.rows, index)

    def depths(self, z: Array, near: IntArray, outer: BoolArray) -> Array:
        """See `DeformedSurface`. Every node near has the displacements by contact and friction of its contact node, and
        all others of the contact point beside it. Those farther off are about where they are, which tells what is
        inside."""
        surface, facets, rows = self.surface, self.surface.facets, self.contact.rows
        nodes = facets.near(near)
        x = placed_some(facets.basis, rows, nodes)
        own = np.flatnonzero((surface.owner[nodes] >= 0) & (facets.points[nodes] < surface.n_contact))
        beside, which = np.unique(facets.points[nodes[own]], return_inverse=True)
        every, contact = self.contact.every, self.contact.contact
        settled = every.positions(rows, beside) - placed_some(surface.points.material.basis, rows, beside)
        x[own] += settled[which]
        if contact is not None:
            of = surface.owner[nodes[own]]
            v = surface.compliance.displacement(of, *contact.start.node_forces)
            if every.given is not None:
                v = v + every.given.of_nodes(of) - every.given_displacement(beside)[which]
            x[own] += to_world(every.carriers(rows, beside)[which], v)
        whole = facets.beside(surface.points, rows, self.approximate)
        whole[nodes] = x
        return facets.depths(z, whole, nodes, outer)


def _normals(points: ContactPoints, rows: Array, index: IntArray) -> Array:
    """cof(F) N (m, dim): the deformed surface normals, without the displacement by contact."""
    normal = points.material.surface_normal[index]
    return np.asarray((cofactor(points.deformation(rows, index)) @ normal[..., None])[..., 0])
