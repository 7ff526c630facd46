"""Contact of a collider's tips, edges and thin limbs with the surface of a reduced body without mechanics.

Its surface does not give way under a single point, so that no dent tilts the facet under it. Where it does, in full
space and in condensed contact, points press along a normal of the collider instead (`sharp_planes.py`).

A point p of the collider (`runtime/colliders/sharp_points.py`) inside the body is at a depth d(x) below the nearest
point c of the deformed surface, and

    W(x) = sum_p a (k/3) d_p^3,    d = |r|,    r = c - p,    c = sum_i N_i x_i nearest to p,

with the stiffness k of the penalty, and a the area of a square (in 2D the length) between such points. With f = d^2/2,
E_j the edges of the face on which c lies (a facet, an edge or a corner), and s_ij = dE_j/dx_i, which is 1, -1 or 0,

    df/dx_i = N_i r,    d2f/dx_i dx_j = N_i N_j I - sum_kl h_ik (E^T E)^-1_kl h_jl^T,    h_ik = N_i E_k + s_ik r,

so that W has the gradient a k d df/dx and the Hessian a k (d d2f/dx2 + df/dx df/dx^T / d). A dent is convex seen from
inside the body, so that d is C1 there: its direction turns from facet to facet without a jump.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.contact.sharp_point_search import SharpPointSearch
from softprint.runtime.contact.surface_quadrature import FacetPoints
from softprint.runtime.mesh.mesh import Mesh


@dataclass(frozen=True, eq=False)
class SharpTerms:
    """Contact of m points of a collider with the surface. points: the nearest points of the surface; weight: a k
    [N/m^2]; depth: d (m,) [m]; way: r (m, dim) [m], out of the body."""

    points: FacetPoints
    weight: float
    depth: Array
    way: Array

    @property
    def index(self) -> IntArray:
        """(m,) of all."""
        return np.arange(len(self.depth))

    @property
    def energy(self) -> float:
        """W [J]."""
        return float(self.weight / 3.0 * (self.depth**3).sum())

    @property
    def gradient(self) -> Array:
        """By the nearest points of the surface (m, dim) [N]."""
        return (self.weight * self.depth)[:, None] * self.way

    @property
    def normal(self) -> Array:
        """(m, dim) unit normals, out of the collider and into the body."""
        return -self.way / self.depth[:, None]

    def hessian(self, x: Array) -> Array:
        """By the nodes (m, c, c, dim, dim) [N/m] of the facets, with the nodes at x (n_nodes, dim) [m]."""
        N, r = self.points.shares, self.way
        edges, slope = _edges(x[self.points.nodes], N > 0.0)
        h = N[:, :, None, None] * edges[:, None] + slope[..., None] * r[:, None, None]
        metric = np.einsum("mka,mla->mkl", edges, edges)
        unused = np.arange(metric.shape[1])
        metric[:, unused, unused] += ~edges.any(axis=2)  # rows of zeros in h
        relaxed = np.linalg.solve(metric[:, None], h)
        blocks = np.einsum("mi,mj,ab->mijab", N, N, np.eye(x.shape[1]))
        blocks -= np.einsum("mika,mjkb->mijab", h, relaxed)
        first = N[:, :, None] * r[:, None]
        blocks *= self.depth[:, None, None, None, None]
        blocks += np.einsum("mia,mjb->mijab", first, first / self.depth[:, None, None])
        return self.weight * blocks


def _edges(corners: Array, active: BoolArray) -> tuple[Array, Array]:
    """E (m, c, dim), edges from the first to each other active corner (m, c), and s (m, c, c), its first axis that of
    the corners; zero for the corners that have no edge."""
    m, c, _ = corners.shape
    rows, first = np.arange(m), active.argmax(axis=1)
    has_edge = active.copy()
    has_edge[rows, first] = False
    edges = np.where(has_edge[..., None], corners - corners[rows, first][:, None], 0.0)
    slope = np.eye(c) * has_edge[:, None, :]
    slope[rows, first] = -1.0 * has_edge
    return edges, slope


class SharpContact:
    """Contact of the sharp points of one collider with the surface of a body."""

    def __init__(self, collider: Collider, law: PenaltyContact, mesh: Mesh) -> None:
        """law: with contact on facets."""
        self._search = SharpPointSearch(collider, law, mesh)

    @classmethod
    def of(cls, collider: Collider, law: PenaltyContact, mesh: Mesh) -> SharpContact | None:
        """None where contact is at nodes, or the collider has no sharp points."""
        found = cls(collider, law, mesh) if law.refinement else None
        return found if found is not None and len(found._search) else None

    def terms(self, x: Array, pose: RigidPose) -> SharpTerms:
        """With the nodes at x (n_nodes, dim) [m] and the collider at a pose."""
        inside = self._search.met(x, pose, margin=0.0)
        way = inside.points.positions(x) - inside.world
        return SharpTerms(inside.points, self._search.weight, inside.depth, way)
