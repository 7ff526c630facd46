"""Contact by a barrier instead of a penalty: incremental potential contact (Li et al. 2020), by the IPC Toolkit.

The triangles of the body's surface and of a collider (in 2D segments) repel each other within a small distance,

    W = integral of kappa b(d; distance) over the surfaces,     b -> infinity as d -> 0,

and no step is taken along which two of them would meet. So nothing passes through, however thin or sharp it is, at many
times the cost of a penalty, and without friction. The barrier is scaled as in Li et al. 2023, so that kappa is a
pressure, and forces converge as the meshes are refined and the distance shrinks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from softprint.fem_truth.linalg.block_matrix import BlockMatrix
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.level_set import CELLS, collider_surface
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh.mesh import Mesh

try:
    import ipctk
except ImportError as error:
    raise SoftprintError(
        f"contact.model = \"barrier\" needs the IPC Toolkit ({error}): pip install 'softprint[barrier]'"
    ) from error

# kappa, in Young's moduli: it changes how wide a gap a pressure leaves, and not the limit of a small distance.
_STIFFNESS = 5.0
# The distance, in distances between surface nodes, where none is given.
_DISTANCE = 0.03
# Cells along the longest side of a collider that has no facets of its own, at least.
_FEWEST = 24


@dataclass(frozen=True)
class BarrierLaw:
    """distance: within which surfaces repel each other [m]; stiffness: kappa [Pa; in 2D the same]."""

    distance: float
    stiffness: float

    @classmethod
    def of(cls, distance: float | None, mesh: Mesh, young: float) -> BarrierLaw:
        """With a distance, or with one that suits the mesh, and a stiffness that suits Young's modulus [Pa]."""
        return cls(distance or _DISTANCE * mesh.surface_spacing, _STIFFNESS * young)


def _surface(collider: Collider, mesh: Mesh) -> tuple[Array, IntArray]:
    """Vertices [m] and facets of a collider: those of its file, or half as large as those of the body and small enough
    for its thinnest extent."""
    if isinstance(collider, GridCollider):
        return collider.vertices, collider.facets
    extent = collider.upper - collider.lower
    if not np.isfinite(extent).all():
        return collider_surface(collider)  # which says that there is none
    along = max(2.0 * extent.max() / mesh.surface_spacing, 3.0 * extent.max() / extent.min())
    return collider_surface(collider, int(np.clip(along, _FEWEST, CELLS[mesh.dim])))


class CollisionSurfaces:
    """The surface of a body and that of a collider, as one mesh for the IPC Toolkit."""

    def __init__(self, mesh: Mesh, collider: Collider, law: BarrierLaw) -> None:
        vertices, facets = _surface(collider, mesh)
        self.law, self.name = law, collider.name
        self.nodes: IntArray = mesh.surface_nodes
        self._solid, n, dim = vertices, len(self.nodes), mesh.dim
        both = np.vstack([np.searchsorted(self.nodes, mesh.facets), facets + n]).astype(np.int32)
        # Apart at rest, where areas are measured.
        away = 4.0 * (np.ptp(mesh.points, axis=0).max() + np.ptp(vertices, axis=0).max())
        rest = np.asfortranarray(np.vstack([mesh.points[self.nodes], vertices + away]))
        edges, faces = (both, np.empty((0, 3), np.int32)) if dim == 2 else (ipctk.edges(both), both)
        self.mesh: Any = ipctk.CollisionMesh(rest, edges, faces)
        solid = np.r_[np.zeros(n, dtype=np.int32), np.ones(len(vertices), dtype=np.int32)]
        self.mesh.can_collide = ipctk.make_vertex_patches_filter(solid)
        self.potential: Any = ipctk.BarrierPotential(law.distance, law.stiffness, True)

    def vertices(self, x: Array, pose: RigidPose) -> Array:
        """Those of both surfaces, with the nodes at x (n_nodes, dim) [m] and the collider at a pose."""
        return np.asfortranarray(np.vstack([x[self.nodes], pose.apply(self._solid)]))

    def free_share(self, start: Array, end: Array) -> float:
        """The share of a linear motion of all vertices along which no surfaces meet."""
        return float(ipctk.compute_collision_free_stepsize(self.mesh, start, end))

    def require_apart(self, x: Array, pose: RigidPose) -> None:
        """Raises SoftprintError where the surfaces intersect."""
        if ipctk.has_intersections(self.mesh, self.vertices(x, pose)):
            raise SoftprintError(
                f'collider {self.name!r} intersects the body at the start: with contact.model = "barrier" it must '
                "begin outside"
            )


class BarrierContact:
    """The barrier between a body and a collider at one pose: a `Potential`. x: positions from which the energy is
    evaluated; it is infinite at positions that are not reached from the last accepted ones without collision."""

    def __init__(self, surfaces: CollisionSurfaces, pose: RigidPose, x: Array) -> None:
        self._surfaces, self.pose = surfaces, pose
        self._accepted, self._at = surfaces.vertices(x, pose), np.empty(0)
        self._vertices: Array
        self._collisions: Any

    @property
    def nodes(self) -> IntArray:
        """The surface nodes, on which contact may act."""
        return self._surfaces.nodes

    def accepted(self, x: Array) -> bool:
        """From here on steps start at x, with the same energy."""
        self._accepted = self._surfaces.vertices(x, self.pose)
        return False

    def energy(self, x: Array) -> float:
        """[J]"""
        own = self._surfaces
        self._find(x)
        if not ipctk.is_step_collision_free(own.mesh, self._accepted, self._vertices):
            return np.inf
        return float(own.potential(self._collisions, own.mesh, self._vertices))

    def gradient(self, x: Array) -> Array:
        """(n_nodes, dim) [N]."""
        own, result = self._surfaces, np.zeros_like(x)
        self._find(x)
        by_vertex = own.potential.gradient(self._collisions, own.mesh, self._vertices)
        result[self.nodes] = by_vertex.reshape(self._vertices.shape)[: len(self.nodes)]
        return result

    def add_hessian(self, x: Array, matrix: BlockMatrix, convex: bool) -> None:
        """Its positive part, convex or not: Newton's method with the barrier's negative curvature hardly converges
        faster."""
        own, n, dim = self._surfaces, len(self.nodes), x.shape[1]
        self._find(x)
        clamp = ipctk.PSDProjectionMethod.CLAMP
        full = own.potential.hessian(self._collisions, own.mesh, self._vertices, clamp)
        blocks = sp.bsr_matrix(sp.csr_matrix(full)[: n * dim, : n * dim], blocksize=(dim, dim))
        row = np.repeat(np.arange(n), np.diff(blocks.indptr))
        column, data = blocks.indices, blocks.data
        own_node, above = row == column, row < column
        matrix.add_diagonal(self.nodes[row[own_node]], data[own_node])
        pairs = np.zeros((int(above.sum()), 2, 2, dim, dim))
        pairs[:, 0, 1], pairs[:, 1, 0] = data[above], data[above].transpose(0, 2, 1)
        matrix.add_facets(np.column_stack([self.nodes[row[above]], self.nodes[column[above]]]), pairs)

    def touched(self, x: Array) -> IntArray:
        """(k,) nodes that contact acts on, ascending."""
        return np.flatnonzero(self.gradient(x).any(axis=1))

    def gap(self, x: Array) -> float:
        """The least distance between the surfaces where they repel each other [m]."""
        self._find(x)
        return float(np.sqrt(self._collisions.compute_minimum_distance(self._surfaces.mesh, self._vertices)))

    def max_depth(self, x: Array) -> float:
        """0: nothing penetrates."""
        return 0.0

    def _find(self, x: Array) -> None:
        """The pairs within the distance at x."""
        if self._at is x:
            return
        own = self._surfaces
        self._at, self._vertices = x, own.vertices(x, self.pose)
        self._collisions = ipctk.NormalCollisions()
        self._collisions.use_area_weighting = True
        self._collisions.build(own.mesh, self._vertices, own.law.distance)
