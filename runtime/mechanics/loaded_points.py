"""The points of the surface of a body at which contact forces act, and how the contact nodes share these forces.

The compliance is known at contact nodes (`surface_compliance.py`). Contact acts at the contact nodes themselves, or at
points on the facets between them, so that less fits through between two points. A force f on a point acts on the
contact nodes of its facet with the shares N, and the displacement of the point is interpolated with the same shares,

    f_a = sum_p N_pa f_p,    u_p = sum_a N_pa u_a,

so that the compliance among points is N G N^T, symmetric like G. Nodes of rigid frames have no compliance: the shares
of a facet at the edge of a frame sum to less than one.

The points and their areas are a rule that integrates pressure over the surface, which is what the forces are right by.
Simpson's, with the middle and the corners of every facet, is exact for what is quadratic on it, with half as many
points again as facets. With the middles alone, forces of a small tip depend on where between the points it presses: on
the small Jelly by 3.6 %, where four points on a facet leave 1.6.

Where the contact nodes are fewer than the nodes of the surface, each node of the surface belongs to the nearest contact
node. The facets are then those whose nodes belong to different contact nodes: one for each triangle of the
triangulation that is dual to the regions of the contact nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, BoolArray, IntArray, scatter_sum
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.means import means, numbered, shared
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance, outside_frames
from softprint.runtime.mesh.facet_lattice import lattice
from softprint.runtime.mesh.mesh import Mesh, facet_vectors
from softprint.runtime.mesh.midpoints import midpoints

# Simpson's rule: the share of a facet's area at each of its corners; the middle has the rest.
_CORNER = {2: 1.0 / 6.0, 3: 1.0 / 12.0}
# On an edge of the body, where a facet is turned from the mean normal of a node by more than 30 degrees, its sides
# would bear on what presses its top: facets there have a point in the middle alone, and so have those at rigid frames.
_EVEN = 0.866
# Where points of a facet are farthest from middles and corners: at so many parts of its edges.
_PARTS = {2: 4, 3: 3}


@dataclass(frozen=True, eq=False)
class LoadedPoints:
    """n points, each a weighted mean of c nodes of the mesh. corners: (n, c) these nodes, and weights: (n, c); nodes:
    (n, c) numbers of contact nodes, and shares: N (n, c); areas: (n,) [m^(dim-1)]; normals: (n, dim) outward unit
    normals at rest."""

    corners: IntArray
    weights: Array
    nodes: IntArray
    shares: Array
    areas: Array
    normals: Array

    @classmethod
    def of_compliance(cls, body: ReducedBody, compliance: SurfaceCompliance, points: int) -> LoadedPoints:
        """The points that the body has compliance at. points: see `PenaltyContact.reduced_points`."""
        if not points:
            return cls.at_nodes(body, compliance.nodes, compliance.areas)
        return cls.between(body, compliance.nodes, outside_frames(body)[0], points)

    @classmethod
    def of_samples(cls, body: ReducedBody, points: int) -> LoadedPoints:
        """The surface samples of a body, or points on facets between them, like `of_compliance`."""
        if not points:
            return cls.at_nodes(body, body.surface.nodes, body.surface.areas)
        return cls.between(body, body.surface.nodes, body.mesh.surface_nodes, points)

    @classmethod
    def at_nodes(cls, body: ReducedBody, nodes: IntArray, areas: Array) -> LoadedPoints:
        """Nodes (n,) with lumped areas (n,)."""
        normals = body.node_points(nodes).surface_normal
        one = np.ones((len(nodes), 1))
        return cls(nodes[:, None], one, np.arange(len(nodes))[:, None], one, areas, normals)

    @classmethod
    def between(cls, body: ReducedBody, nodes: IntArray, bearing: IntArray, points: int) -> LoadedPoints:
        """Points on the facets between nodes (n,): middles and corners by Simpson's rule for 1, otherwise so many along
        an edge; on all facets where these are the nodes of the surface that bear forces."""
        mesh, owner = body.mesh, _owners(body, nodes, bearing)
        facets = mesh.facets[(owner[mesh.facets] >= 0).any(axis=1)]
        centres = mesh.points[facets].mean(axis=1)
        vectors = facet_vectors(mesh.points, facets)
        size = np.linalg.norm(vectors, axis=1)
        chosen = _between_different(facets, owner)
        nearest = cKDTree(centres[chosen]).query(centres)[1]
        area = scatter_sum(nearest, size, len(chosen))
        normals, of = vectors[chosen] / size[chosen, None], owner[facets[chosen]]
        if points > 1:
            return cls._inside(facets[chosen], of, area, normals, midpoints(points, mesh.dim))
        bears = (of >= 0) & ~_on_sharp_edges(mesh)[nodes[of]]
        corner = (area * _CORNER[mesh.dim] * bears.all(axis=1))[:, None].repeat(mesh.dim, axis=1)
        middles = cls._inside(facets[chosen], of, area - corner.sum(axis=1), normals, midpoints(1, mesh.dim))
        at_nodes = scatter_sum(of[of >= 0], corner[of >= 0], len(nodes))
        return middles._and_nodes(cls.at_nodes(body, nodes, at_nodes).take(at_nodes > 0.0))

    @classmethod
    def _inside(
        cls, facets: IntArray, owner: IntArray, areas: Array, normals: Array, weights: Array
    ) -> LoadedPoints:
        """The points of facets (f, dim) with the same weights (k, dim) on each. owner: (f, dim) contact nodes of the
        corners, -1 for none; areas: (f,), in equal parts."""
        of_facet = np.repeat(np.arange(len(facets)), len(weights))
        every, of = np.tile(weights, (len(facets), 1)), owner[of_facet]
        return cls(
            facets[of_facet],
            every,
            np.maximum(of, 0),
            np.where(of >= 0, every, 0.0),
            areas[of_facet] / len(weights),
            normals[of_facet],
        )

    def _and_nodes(self, nodes: LoadedPoints) -> LoadedPoints:
        """Followed by points that are contact nodes (m,)."""
        c = self.corners.shape[1]
        first = np.eye(1, c)
        return LoadedPoints(
            np.concatenate([self.corners, nodes.corners.repeat(c, axis=1)]),
            np.concatenate([self.weights, nodes.weights * first]),
            np.concatenate([self.nodes, nodes.nodes.repeat(c, axis=1)]),
            np.concatenate([self.shares, nodes.shares * first]),
            np.concatenate([self.areas, nodes.areas]),
            np.concatenate([self.normals, nodes.normals]),
        )

    def __len__(self) -> int:
        return len(self.areas)

    def take(self, which: slice | BoolArray) -> LoadedPoints:
        """Some of the points."""
        return LoadedPoints(*(getattr(self, field.name)[which] for field in fields(self)))

    def followed_by(self, index: IntArray, nodes: IntArray, shares: Array) -> LoadedPoints:
        """With other points (m,), numbered from len(self) on and ascending, that have these nodes and shares (m, c);
        numbers in between are of no points."""
        n, size = len(self), int(index[-1]) + 1
        joined = np.zeros((size, nodes.shape[1]), dtype=np.int64), np.zeros((size, nodes.shape[1]))
        for column, first, others in zip(joined, (self.nodes, self.shares), (nodes, shares), strict=True):
            column[:n], column[index] = first, others
        other = replace(self, nodes=joined[0], shares=joined[1])
        other.__dict__["n_nodes"] = max(self.n_nodes, int(nodes.max()) + 1)
        return other

    @lazy
    def n_nodes(self) -> int:
        """The number of contact nodes."""
        return int(self.nodes.max()) + 1

    @property
    def are_nodes(self) -> bool:
        """Whether the points are the contact nodes."""
        return self.nodes.shape[1] == 1

    def material(self, body: ReducedBody) -> MaterialPoints:
        """The points as material points of their body."""
        at = body.node_points()
        if self.are_nodes:
            return at.take(self.corners[:, 0])
        rest, basis, gradient = (self.mean(of) for of in (at.rest, at.basis, at.basis_gradient))
        return MaterialPoints(rest, basis, gradient, np.zeros(len(self)), self.normals)

    def felt(self, index: IntArray, forces: Array) -> tuple[IntArray, Array]:
        """The contact nodes (m*c,) that feel forces (m, dim) on some of the points, and what each feels of them
        (m*c, dim). All of a force is felt, by the nodes that can be displaced."""
        nodes, shares = self.nodes[index], self.shares[index]
        shares = shares / shares.sum(axis=1, keepdims=True)
        return nodes.ravel(), (shares[..., None] * forces[:, None]).reshape(nodes.size, forces.shape[1])

    def to_nodes(self, index: IntArray, forces: Array) -> tuple[IntArray, Array]:
        """The contact nodes (k,), ascending, that forces (m, dim) on some of the points (m,) act on, and their forces
        (k, dim)."""
        if self.are_nodes:
            return index, forces
        nodes, corners, shares = self.among(index)
        return nodes, shared(forces, corners, shares, len(nodes))

    def among(self, index: IntArray) -> tuple[IntArray, IntArray, Array]:
        """For some of the points (m,): the contact nodes (k,), ascending, that their forces act on, which of these are
        at their corners (m, c), and the shares (m, c)."""
        return *numbered(self.nodes[index], self.n_nodes), self.shares[index]

    def mean(self, of: Array) -> Array:
        """The means over the corners of a column of the nodes of the mesh."""
        return means(of, self.corners, self.weights)


class Gaps(NamedTuple):
    """What contact points let through. spacing: the distance between the nodes that they are between [m]; radius: of
    the largest circle on the surface that has none inside [m], beside edges of the body only where it has no other
    surface."""

    spacing: float
    radius: float

    @classmethod
    def of(cls, body: ReducedBody, points: LoadedPoints, compliance: SurfaceCompliance) -> Gaps:
        """Of the points that the body has compliance at."""
        mesh, bearing = body.mesh, outside_frames(body)[0]
        share = max(1.0, len(bearing) / len(compliance.nodes))
        even = np.setdiff1d(bearing, np.flatnonzero(_on_sharp_edges(mesh)))
        inside = np.isin(mesh.facets, even).all(axis=1)
        corners = mesh.points[mesh.facets[inside if inside.any() else slice(None)]]
        between = np.einsum("kc,fcd->fkd", lattice(_PARTS[mesh.dim], mesh.dim), corners).reshape(-1, mesh.dim)
        around = cKDTree(points.mean(mesh.points)).query(between)[0]
        return cls(mesh.surface_spacing * float(share) ** (1.0 / (mesh.dim - 1)), float(around.max()))


def _on_sharp_edges(mesh: Mesh) -> BoolArray:
    """(n_nodes,) which nodes are on sharp edges of the surface."""
    normals = mesh.facet_vectors / np.linalg.norm(mesh.facet_vectors, axis=1, keepdims=True)
    of_nodes = mesh.surface_normals[np.searchsorted(mesh.surface_nodes, mesh.facets)]
    turned = (normals[:, None] * of_nodes).sum(axis=2) < _EVEN
    sharp = np.zeros(mesh.n_nodes, dtype=bool)
    sharp[mesh.facets[turned]] = True
    return sharp


def owners(body: ReducedBody, nodes: IntArray) -> IntArray:
    """(n_nodes,) for every node of the surface that contact can displace, its number among contact nodes (n,); -1 for
    the others."""
    return _owners(body, nodes, outside_frames(body)[0])


def _owners(body: ReducedBody, nodes: IntArray, bearing: IntArray) -> IntArray:
    points, owner = body.mesh.points, np.full(body.n_nodes, -1)
    owner[bearing] = cKDTree(points[nodes]).query(points[bearing])[1]
    return owner


def _between_different(facets: IntArray, owner: IntArray) -> IntArray:
    """One facet for each set of different owners of the nodes of a facet; nodes without an owner count as different."""
    of = np.sort(owner[facets], axis=1)
    different = ~((np.diff(of, axis=1) == 0) & (of[:, 1:] >= 0)).any(axis=1)
    candidates = np.flatnonzero(different)
    first = np.unique(of[candidates], axis=0, return_index=True)[1]
    whole = np.bincount(owner[owner >= 0]).max(initial=0) <= 1  # every node its own contact node: all facets
    return candidates if whole else np.sort(candidates[first])
