"""Rest distance of the nodes to the surface of their body, and the direction outward."""

from __future__ import annotations

import igl
import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.mesh import Mesh


def nearest_surface(mesh: Mesh) -> tuple[Array, Array]:
    """(distance (n_nodes,) [m], normal (n_nodes, dim)) of the nearest surface point of every node.

    For an inner node the outward unit normal at the nearest point is the direction to it; a surface node
    has its own area-weighted normal.
    """
    in_space = np.zeros((mesh.n_nodes, 3))  # libigl needs three coordinates; it accepts edges as elements
    in_space[:, : mesh.dim] = mesh.points
    squared, _, closest = igl.point_mesh_squared_distance(in_space, in_space, mesh.facets)
    distance = np.sqrt(np.maximum(squared, 0.0))
    normal = (closest - in_space)[:, : mesh.dim] / np.maximum(distance, np.finfo(float).tiny)[:, None]
    distance[mesh.surface_nodes] = 0.0
    normal[mesh.surface_nodes] = mesh.surface_normals
    return distance, normal
