"""The surface points at which the runtime evaluates contact, each with the area it represents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray, scatter_sum
from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.mesh import Mesh


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """nodes: (s,) surface node indices, ascending; areas: (s,) [m^(dim-1)], together the whole surface."""

    nodes: IntArray
    areas: Array


def sample_surface(mesh: Mesh, at_most: int) -> SurfaceSamples:
    """At most `at_most` surface nodes by farthest-point sampling; the area of every other surface node is added to the
    nearest sample."""
    points = mesh.points[mesh.surface_nodes]
    if len(points) <= at_most:
        return SurfaceSamples(mesh.surface_nodes, mesh.surface_areas)
    chosen = np.sort(farthest_points(points, at_most))
    _, nearest = cKDTree(points[chosen]).query(points)
    return SurfaceSamples(mesh.surface_nodes[chosen], scatter_sum(nearest, mesh.surface_areas, len(chosen)))
