"""The deformed surface of a body in full space, in which colliders that pierce it are searched for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.piercing import DeformedSurface, depths_inside
from softprint.runtime.dynamics.pierced_colliders import PiercedColliders, SearchedSurface
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.lazy import lazy
from softprint.runtime.mesh.mesh import Mesh, node_normals


@dataclass(frozen=True, eq=False)
class DeformedBody:
    """The body at a configuration; its rows are the positions of all nodes."""

    at: Configuration


def full_space_search(mesh: Mesh, colliders: Mapping[str, Collider]) -> PiercedColliders[DeformedBody]:
    """The search for colliders, by name, that have pierced a body in full space."""
    searched = SearchedSurface(_SurfaceNodes(mesh), colliders, mesh.surface_spacing, mesh.surface_spacing)
    return PiercedColliders([searched] if colliders else [])


class _SurfaceNodes:
    def __init__(self, mesh: Mesh) -> None:
        self.nodes = mesh.surface_nodes
        self.facets = np.searchsorted(self.nodes, mesh.facets)

    def at(self, body: DeformedBody) -> DeformedSurface:
        """See `BodySurface`."""
        return _SurfaceNodesAt(self.facets, body.at.rows[self.nodes])


@dataclass(frozen=True, eq=False)
class _SurfaceNodesAt:
    """approximate: exact in fact."""

    facets: IntArray
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
        return np.asarray(self._normals[index])

    def depths(self, z: Array, near: IntArray, outer: BoolArray) -> Array:
        """See `DeformedSurface`."""
        return depths_inside(z, self.approximate, self.facets, near, outer)

    @lazy
    def _normals(self) -> Array:
        return node_normals(self.approximate, self.facets)
