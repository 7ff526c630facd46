"""Places of contact: surface nodes spread by geodesic distance on the rest surface (thesis 5.3.2).

Distances are shortest paths along surface edges: deterministic, the same code in 2D and 3D, and accurate enough
to spread points evenly (they overestimate the true geodesic distance by a mesh-dependent factor that hardly varies
over the surface).
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from softprint.fem_truth.sampling.farthest import farthest_selection
from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.placement import in_box
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

# [[lower corner], [upper corner]] [m] of the body at rest; None: everywhere.
Region = tuple[tuple[float, ...], tuple[float, ...]] | None


def surface_distances(mesh: Mesh, sources: IntArray) -> Array:
    """(n_surface,) distance along surface edges [m] from each surface node to the nearest of ``sources``
    (mesh nodes).

    Infinite on pieces of the surface without a source.
    """
    nodes = mesh.surface_nodes
    ends = np.searchsorted(nodes, mesh.surface_edges)
    lengths = np.linalg.norm(
        mesh.points[mesh.surface_edges[:, 0]] - mesh.points[mesh.surface_edges[:, 1]], axis=1
    )
    graph = csr_matrix((lengths, (ends[:, 0], ends[:, 1])), shape=(len(nodes), len(nodes)))
    return dijkstra(graph, directed=False, indices=np.searchsorted(nodes, sources), min_only=True)


def candidate_places(body: ReducedBody, clearance: float, region: Region = None) -> BoolArray:
    """(n_surface,) mask of the surface nodes allowed as contact places: those in the region, and farther than
    ``clearance`` [m] from every rigid frame.

    A frame does not deform, so a collider aimed close to one would mostly press on the frame.
    """
    nodes, frame_nodes = body.mesh.surface_nodes, body.handles.frame_nodes
    points = body.mesh.points[nodes]
    inside = np.ones(len(nodes), dtype=np.bool_) if region is None else in_box(points, region)
    if len(frame_nodes) == 0:
        return inside
    distance, _ = cKDTree(body.mesh.points[frame_nodes]).query(points)
    return inside & (distance > clearance) & ~np.isin(nodes, frame_nodes)


def places_by_state(
    body: ReducedBody, count: int, n_states: int, clearance: float, region: Region = None
) -> IntArray:
    """(n_states, count) places, spread over the surface for each state. Different states have different places as long
    as the surface has enough nodes, so that the training data has as many places as possible."""
    n_allowed = int(candidate_places(body, clearance, region).sum())
    sets = int(np.clip(n_allowed // max(count, 1), 1, n_states))
    places = spread_places(body, sets * count, clearance, region)
    # Each state gets every sets-th place in farthest-point order, which is spread as well as all places are.
    return np.stack([places[state % sets :: sets] for state in range(n_states)])


def spread_places(body: ReducedBody, count: int, clearance: float, region: Region = None) -> IntArray:
    """``count`` surface nodes (mesh numbers) in farthest-point order, beginning with the one farthest from the
    frames.

    Without frames the first is the surface node farthest from the body's centroid.
    """
    mesh = body.mesh
    allowed = np.flatnonzero(candidate_places(body, clearance, region))
    if len(allowed) < count:
        raise SoftprintError(
            f"sampling.places = {count}, but only {len(allowed)} surface nodes of {body.name!r} lie farther "
            f"than {clearance:.4g} m from its frames{'' if region is None else ' and in sampling.region'}: ask for "
            "fewer places, lower sampling.frame_clearance, or refine the mesh"
        )
    frames_on_surface = np.intersect1d(body.handles.frame_nodes, mesh.surface_nodes)
    if len(frames_on_surface):
        exposure = surface_distances(mesh, frames_on_surface)[allowed]
        exposure[np.isinf(exposure)] = -1.0
    else:
        exposure = np.linalg.norm(mesh.points[mesh.surface_nodes[allowed]] - mesh.points.mean(axis=0), axis=1)
    chosen = farthest_selection(
        lambda k: surface_distances(mesh, mesh.surface_nodes[allowed[k : k + 1]])[allowed],
        int(np.argmax(exposure)),
        count,
    )
    return mesh.surface_nodes[allowed[chosen]]
