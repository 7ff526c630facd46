"""The body data that a full-space solve needs, for the cells and nodes on this rank.

Vectors are in the body's node order at the public interface of every solver, and in the part's order inside: `take` and
`whole` convert between the two. A rank that solves alone has the whole body as its part, at no extra cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from softprint.fem_truth.parts.group import GroupShare, nodes_of_parts
from softprint.fem_truth.parts.partition import partition
from softprint.fem_truth.parts.share import WHOLE, Share
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.contact.sharp_planes import SharpPlanes, SharpSurface
from softprint.runtime.contact.surface_quadrature import SurfaceQuadrature
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody


@dataclass(frozen=True, eq=False)
class BodyPart:
    """The cells of one rank and their nodes, owned nodes first. mesh, material: of these cells."""

    body: ReducedBody
    mesh: Mesh
    material: Material
    share: Share

    def take(self, values: Array) -> Array:
        """Values at the part's nodes (n, ...), from those at all nodes of the body (n_nodes, ...)."""
        return self.share.take(values)

    def whole(self, values: Array) -> Array:
        """Values at all nodes of the body (n_nodes, ...), on every rank, from those at the part's nodes (n, ...)."""
        return self.share.gather(values)

    def shares(self, values: Array) -> Array:
        """Same as `take`, with 0 at nodes owned by another rank: a sum over all parts counts every node once."""
        shares = self.take(values)
        for run in self.share.runs[1:]:
            shares[run] = 0.0
        return shares

    def reduced_positions(self, rows: Array) -> Array:
        """(n, dim) x = U rows [m]."""
        return self.take(self.body.reduced_positions(rows))

    def handle_force(self, gradient: Array) -> Array:
        """(n_rows, dim) [N] U^T times the gradient of an energy at the part's nodes (n, dim) [N]: its derivative by the
        handle rows, with the displacement outside the subspace fixed. By the envelope theorem also that of the energy
        of the equilibria with these rows."""
        owned = self.share.owned
        return self.share.total(self._basis[owned].T @ gradient[owned])

    @cached_property
    def _basis(self) -> Array:
        """The rows of U (n, n_rows)."""
        return self.take(self.body.basis)

    @cached_property
    def node_mass(self) -> Array:
        """(n,) lumped masses [kg], as `shares`."""
        return self.shares(self.body.node_mass)

    @cached_property
    def constraint_basis(self) -> Array:
        """The rows of `ReducedBody.constraint_basis` (n, n_points)."""
        return self.take(self.body.constraint_basis)

    @cached_property
    def frame_nodes(self) -> IntArray:
        """(n_frame,) nodes of rigid frames."""
        return self.local(self.body.handles.frame_nodes)

    @cached_property
    def surface_nodes(self) -> IntArray:
        """(n_surface,) nodes on the body's surface that this rank owns."""
        own = np.arange(len(self.mesh.points))[self.share.owned]
        return np.intersect1d(self.local(self.body.mesh.surface_nodes), own)

    @cached_property
    def surface_areas(self) -> Array:
        """(n_surface,) lumped area of each [m^2; in 2D m]."""
        areas = np.zeros(self.body.n_nodes)
        areas[self.body.mesh.surface_nodes] = self.body.mesh.surface_areas
        return self.take(areas)[self.surface_nodes]

    def contact_points(self, refinement: int) -> SurfaceQuadrature:
        """The points of the surface at which this rank evaluates contact: those of the nodes that it owns, or on the
        facets of its cells; see `PenaltyContact.refinement`."""
        if refinement == 0:
            return SurfaceQuadrature.at_nodes(self.surface_nodes, self.surface_areas)
        return SurfaceQuadrature.on_facets(self.mesh.points, self.surface_facets, refinement)

    def sharp_planes(self, surface: SharpSurface, normals: Array) -> SharpPlanes:
        """The planes of a collider's sharp points during one solve, of which this rank counts those on facets of its
        cells; normals: (n_nodes, dim) of the body's surface without dents."""
        if self.mesh is self.body.mesh:
            return SharpPlanes(surface, normals)
        return SharpPlanes(surface, normals, self._facet_nodes, self.whole)

    @cached_property
    def _facet_nodes(self) -> IntArray:
        """(f, dim) nodes in the part by the number of the facet in the body, -1 for facets of other ranks' cells."""
        in_body, nodes = self._own_facets
        local = np.full((len(self.body.mesh.facets), self.body.dim), -1)
        local[in_body] = nodes
        return local

    @cached_property
    def surface_facets(self) -> IntArray:
        """(f, dim) facets of the body's surface that are of this rank's cells."""
        return self._own_facets[1]

    @cached_property
    def _own_facets(self) -> tuple[IntArray, IntArray]:
        """The facets of the body's surface that are of this rank's cells: their numbers (f,) in the body, and their
        nodes (f, dim) in the part."""
        facets = self.mesh.facets
        if self.mesh is self.body.mesh:
            return np.arange(len(facets)), facets
        # Facets of this part that are not of the surface lie between parts.
        number = self.take(np.arange(self.body.n_nodes, dtype=float)).astype(np.int64)
        own, whole = np.sort(number[facets], axis=1), np.sort(self.body.mesh.facets, axis=1)
        _, first, place = np.unique(
            np.concatenate([whole, own]), axis=0, return_index=True, return_inverse=True
        )
        in_body = first[place.ravel()[len(whole) :]]
        return in_body[in_body < len(whole)], facets[in_body < len(whole)]

    def local(self, nodes: IntArray) -> IntArray:
        """The part's nodes that are among ``nodes`` of the body."""
        among = np.zeros(self.body.n_nodes, dtype=bool)
        among[nodes] = True
        return np.flatnonzero(self.take(among))


def whole_body(body: ReducedBody) -> BodyPart:
    """The body as one part."""
    return BodyPart(body, body.mesh, body.material, WHOLE)


def part_of_body(body: ReducedBody, comm: MPI.Intracomm) -> BodyPart:
    """This rank's part of a body that the ranks of ``comm`` solve together; each of them has already loaded the whole
    body. Needs no communication. Raises SoftprintError if there are more ranks than cells."""
    if comm.size == 1:
        return whole_body(body)
    mesh = body.mesh
    if comm.size > mesh.n_cells:
        raise SoftprintError(
            f"{body.name}: {comm.size} ranks cannot share a body of {mesh.n_cells} cells; use fewer ranks per solve"
        )
    part = partition(mesh.cell_centroids, comm.size)
    share = GroupShare(comm, nodes_of_parts(mesh.cells, part, comm.size, mesh.n_nodes))
    cells = np.flatnonzero(part == comm.rank)
    number = np.empty(mesh.n_nodes, dtype=np.int64)
    number[share.nodes] = np.arange(len(share.nodes))
    local = Mesh(mesh.points[share.nodes], number[mesh.cells[cells]])
    return BodyPart(body, local, body.material.at(cells), share)
