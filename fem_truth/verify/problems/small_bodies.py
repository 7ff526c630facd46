"""Bodies of the dynamic cases: blocks and bars of simplices with known properties.

All are integrated over all cells, so that only the mesh, the subspace and the time step cause errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.body.basis import biharmonic_basis
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.body.handles import FrameHandle, Handles
from softprint.runtime.body.placement import place_handles
from softprint.runtime.body.surface_samples import SurfaceSamples
from softprint.runtime.dynamics import KinematicHandle
from softprint.runtime.elasticity import make_material
from softprint.runtime.mesh import Mesh

#: Density of every body here [kg/m^dim].
DENSITY = 1000.0


@dataclass(frozen=True)
class Stuff:
    """A material by its name, Young's modulus [Pa] and Poisson's ratio."""

    model: str
    young: float
    poisson: float


def node_body(mesh: Mesh, stuff: Stuff) -> ReducedBody:
    """A body whose subspace is full space: every node is a point handle."""
    return _body(mesh, stuff, Handles(mesh.dim, np.arange(mesh.n_nodes), ()), np.eye(mesh.n_nodes))


def point_body(mesh: Mesh, stuff: Stuff, points: int) -> ReducedBody:
    """A body with this many point handles and their biharmonic coordinates, as in the runtime."""
    handles = place_handles(mesh, points, [])
    return _body(mesh, stuff, handles, biharmonic_basis(mesh, handles))


def affine_body(mesh: Mesh, stuff: Stuff) -> ReducedBody:
    """A body whose subspace is the affine maps: dim + 1 corners of its box are handles, and all positions are
    barycentric combinations of these (as in every basis of dim + 1 points that is linearly precise)."""
    low, extent = mesh.points.min(axis=0), np.ptp(mesh.points, axis=0)
    corners = low + np.vstack([np.zeros(mesh.dim), np.diag(extent)])
    nodes = np.array([int(np.abs(mesh.points - corner).sum(axis=1).argmin()) for corner in corners])
    shares = (mesh.points - low) / extent
    basis, order = np.column_stack([1.0 - shares.sum(axis=1), shares]), np.argsort(nodes)
    return _body(mesh, stuff, Handles(mesh.dim, nodes[order], ()), basis[:, order])


def rigid_body(mesh: Mesh, stuff: Stuff) -> ReducedBody:
    """A body whose subspace is the rigid motions: all nodes are one frame."""
    frame = FrameHandle("all", np.arange(mesh.n_nodes), mesh.points.mean(axis=0))
    basis = np.column_stack([mesh.points, np.ones(mesh.n_nodes)])
    return _body(mesh, stuff, Handles(mesh.dim, np.empty(0, dtype=np.int64), (frame,)), basis)


def held_handles(body: ReducedBody, places: Sequence[float]) -> list[KinematicHandle]:
    """The point handles with one of these first coordinates [m], fixed in place: for a `node_body` all such nodes."""
    first = body.mesh.points[body.handles.points, :1]
    near = np.isclose(first, np.asarray(places), atol=1e-9 * body.mesh.size).any(axis=1)
    return [KinematicHandle(int(number)) for number in np.flatnonzero(near)]


def _body(mesh: Mesh, stuff: Stuff, handles: Handles, basis: Array) -> ReducedBody:
    density = np.full(mesh.n_cells, DENSITY)
    mass = mesh.lump(density * mesh.cell_volumes)
    young, poisson = np.full(mesh.n_cells, stuff.young), np.full(mesh.n_cells, stuff.poisson)
    return ReducedBody(
        mesh=mesh,
        handles=handles,
        basis=basis,
        material=make_material(stuff.model, young, poisson),
        density=density,
        node_mass=mass,
        reduced_mass=basis.T @ (mass[:, None] * basis),
        cubature=Cubature(np.arange(mesh.n_cells), mesh.cell_volumes, 0.0, 0.0),
        surface=SurfaceSamples(mesh.surface_nodes, mesh.surface_areas),
        name="small",
    )
