"""Sensing places on a body's surface, each a mean over nodes around it.

Positions and strain are means over few nodes, and traction is a mean over the part of the surface that a place
represents:

    x_k = sum_i W_ki x_i,    F_k = sum_i W_ki F_i,    t_k = sum_i P_ki t_i,    sum_i W_ki = sum_i P_ki = 1,

F_i being the deformation gradient at a node, the mean over the cells around it by volume.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray, scatter_sum
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

# A point farther from the surface than this share of the body's size is refused.
_FARTHEST = 0.1
# Candidates for the facet nearest to a point are the facets of this many nearest corners.
_NEAR_NODES = 16


@dataclass(frozen=True, eq=False)
class TouchPlaces:
    """k places. names: (k,); rest: (k, dim) [m] their positions on the body at rest; areas: (k,) [m^(dim-1)] of the
    surface that they represent, zero for points; nodes: W (k, n_nodes); spread: P (k, n_nodes)."""

    names: tuple[str, ...]
    rest: Array
    areas: Array
    nodes: sp.csr_matrix
    spread: sp.csr_matrix

    def __len__(self) -> int:
        return len(self.names)


def surface_places(body: ReducedBody, nodes: IntArray | None = None) -> TouchPlaces:
    """The body's surface samples, or the given nodes, each for the surface nodes nearest to it. Their areas add up to
    the whole surface, so sum_k areas_k t_k is the total force."""
    mesh, samples = body.mesh, body.surface.nodes if nodes is None else nodes
    rest = mesh.points[samples]
    owner = cKDTree(rest).query(mesh.points[mesh.surface_nodes])[1]
    areas = scatter_sum(owner, mesh.surface_areas, len(samples))
    shape = len(samples), mesh.n_nodes
    nodes = sp.csr_matrix((np.ones(len(samples)), (np.arange(len(samples)), samples)), shape)
    share = mesh.surface_areas / areas[owner]
    spread = sp.csr_matrix((share, (owner, mesh.surface_nodes)), shape)
    return TouchPlaces(tuple(f"node_{node}" for node in samples), rest, areas, nodes, spread)


def point_places(body: ReducedBody, points: Mapping[str, ArrayLike]) -> TouchPlaces:
    """The points of the surface nearest to the given ones (dim,) [m] of the body at rest, by name.

    Raises SoftprintError for a point with the wrong number of coordinates, or far from the surface.
    """
    if not points:
        raise SoftprintError("there is no sensing point: give at least one by its coordinates at rest")
    mesh = body.mesh
    near = cKDTree(mesh.points[mesh.surface_nodes])
    rest, weights = [], sp.lil_matrix((len(points), mesh.n_nodes))
    for k, (name, given) in enumerate(points.items()):
        point = np.atleast_1d(np.asarray(given, dtype=float))
        if point.shape != (mesh.dim,) or not np.isfinite(point).all():
            raise SoftprintError(
                f"point {name!r} must be {mesh.dim} numbers [m], not {np.asarray(given).tolist()}"
            )
        corners, share = _nearest_on_surface(mesh, near, point)
        found = share @ mesh.points[corners]
        away = float(np.linalg.norm(found - point))
        if away > _FARTHEST * mesh.size:
            raise SoftprintError(
                f"point {name!r} is {away:.3g} m away from the surface of {body.name!r}; the nearest point of it is "
                f"{', '.join(f'{x:.4g}' for x in found.round(6) + 0.0)}"
            )
        rest.append(found)
        weights[k, corners] = share
    nodes = weights.tocsr()
    return TouchPlaces(tuple(points), np.array(rest), np.zeros(len(points)), nodes, nodes)


def _nearest_on_surface(mesh: Mesh, near: cKDTree, point: Array) -> tuple[IntArray, Array]:
    """Corners (dim,) of the facet nearest to a point, and the barycentric coordinates (dim,) of the nearest point."""
    _, closest = near.query(point, k=min(_NEAR_NODES, len(mesh.surface_nodes)))
    beside = np.isin(mesh.facets, mesh.surface_nodes[closest]).any(axis=1)
    facets = mesh.facets[beside]
    shares = np.array([_closest_share(mesh.points[facet], point) for facet in facets])
    found = np.einsum("fc,fcd->fd", shares, mesh.points[facets])
    best = int(np.argmin(np.linalg.norm(found - point, axis=1)))
    return facets[best], shares[best]


def _closest_share(corners: Array, point: Array) -> Array:
    """Barycentric coordinates (n,) of the point of a segment or triangle, corners (n, dim), nearest to a point.

    The projection onto its line or plane, if that lies within; otherwise the nearest point of its boundary.
    """
    if len(corners) == 1:
        return np.ones(1)
    sides = (corners[1:] - corners[0]).T
    inner = np.linalg.lstsq(sides, point - corners[0], rcond=None)[0]
    share = np.concatenate([[1.0 - inner.sum()], inner])
    if (share >= 0.0).all():
        return share
    options = []
    for left_out in range(len(corners)):
        kept = np.delete(np.arange(len(corners)), left_out)
        option = np.zeros(len(corners))
        option[kept] = _closest_share(corners[kept], point)
        options.append(option)
    return min(options, key=lambda option: float(np.linalg.norm(option @ corners - point)))
