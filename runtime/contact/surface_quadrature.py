"""The points of a body's surface at which contact is evaluated: its nodes, or quadrature points on its facets.

A point is p = sum_a N_a x_a, with the nodes x_a of its facet, and stands for a rest area w. With the gradient g_p and
the Hessian H_p of contact at the points, the nodes get

    gradient  sum_p N_a g_p,        Hessian  sum_p N_a N_b H_p.

Contact at nodes with lumped areas sees nothing that fits between them, and gives the nodes at an edge of the base of a
body a share of its sides. A midpoint rule on equal parts of every facet is exact for a pressure that is constant over
the facet, and sees what is as large as its parts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray, scatter_sum
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.lazy import lazy
from softprint.runtime.mesh.mesh import Mesh, facet_vectors
from softprint.runtime.mesh.midpoints import midpoints
from softprint.runtime.mesh.simplex_kernels import bounding_balls

# Allowance for signed distances that are interpolated or smoothed, and so may change faster than the way.
_STEEPEST = 1.25


@dataclass(frozen=True, eq=False)
class FacetPoints:
    """k points of a surface. nodes: (k, c) of their facets; shares: N (k, c)."""

    nodes: IntArray
    shares: Array

    def __len__(self) -> int:
        return len(self.nodes)

    def positions(self, x: Array) -> Array:
        """(k, dim) [m], with the nodes at x (n_nodes, dim)."""
        return np.asarray((self.shares[:, None, :] @ x[self.nodes])[:, 0])

    def gradient(self, by_point: Array, n_nodes: int) -> Array:
        """By the nodes (n_nodes, dim), of a gradient (k, dim) by the points."""
        by_corner = self.shares[:, :, None] * by_point[:, None, :]
        return np.column_stack(
            [scatter_sum(self.nodes, by_corner[..., axis], n_nodes) for axis in range(by_point.shape[1])]
        )

    def hessian(self, by_point: Array) -> tuple[IntArray, Array]:
        """By the nodes, of a Hessian (k, dim, dim) by the points: the nodes (t, c) of t facets, and their blocks (t, c,
        c, dim, dim) by pairs of these nodes. Points of a facet that follow each other are summed."""
        first = np.flatnonzero(np.r_[True, (np.diff(self.nodes, axis=0) != 0).any(axis=1)][: len(self)])
        pairs = self.shares[:, :, None] * self.shares[:, None, :]
        blocks = pairs[..., None, None] * by_point[:, None, None]
        return self.nodes[first], np.add.reduceat(blocks, first, axis=0) if len(first) else blocks

    def joined(self, others: FacetPoints) -> FacetPoints:
        """These and others with as many corners."""
        nodes = np.concatenate([self.nodes, others.nodes])
        return FacetPoints(nodes, np.concatenate([self.shares, others.shares]))


@dataclass(frozen=True, eq=False)
class SurfaceQuadrature:
    """The points of f facets, n of each. facets: (f, c) their nodes; shares: N (n, c), the same for all facets; areas:
    (f,) at rest [m^2; in 2D m]. Point i is point i mod n of facet i div n, and has a share 1/n of its area."""

    facets: IntArray
    shares: Array
    areas: Array

    @classmethod
    def of(cls, mesh: Mesh, refinement: int) -> SurfaceQuadrature:
        """The points of a whole surface; refinement: see `PenaltyContact`."""
        if refinement == 0:
            return cls.at_nodes(mesh.surface_nodes, mesh.surface_areas)
        return cls.on_facets(mesh.points, mesh.facets, refinement)

    @classmethod
    def at_nodes(cls, nodes: IntArray, areas: Array) -> SurfaceQuadrature:
        """Nodes (f,) with lumped areas (f,)."""
        return cls(nodes[:, None], np.ones((1, 1)), areas)

    @classmethod
    def on_facets(cls, points: Array, facets: IntArray, refinement: int) -> SurfaceQuadrature:
        """The midpoint rule on refinement^(dim-1) equal parts of facets (f, dim) between rest points (n_nodes, dim)."""
        areas = np.linalg.norm(facet_vectors(points, facets), axis=1)
        return cls(facets, midpoints(refinement, points.shape[1]), areas)

    @lazy
    def nodes(self) -> IntArray:
        """(n_surface,) the nodes of all facets, ascending."""
        return np.unique(self.facets)

    def points(self, index: IntArray) -> FacetPoints:
        """Some of the points (k,)."""
        facet, own = np.divmod(index, len(self.shares))
        return FacetPoints(self.facets[facet], self.shares[own])

    def area(self, index: IntArray) -> Array:
        """w (k,) of points (k,)."""
        return self.areas[index // len(self.shares)] / len(self.shares)

    def near(self, x: Array, collider: Collider, pose: RigidPose) -> IntArray:
        """The points (k,), ascending, of all facets that may touch the collider, with the nodes at x (n_nodes, dim)."""
        centre, radius = bounding_balls(x, self.facets)
        reach = _STEEPEST * radius
        about, _, distance = collider.closer_to(centre, pose, float(reach.max(initial=0.0)))
        facets = about[distance <= reach[about]]
        return (facets[:, None] * len(self.shares) + np.arange(len(self.shares))).ravel()
