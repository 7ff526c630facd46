"""How a held body at rest gives way, by linear elasticity: under its own weight, and to a press at a place."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.compliance.null_space_compliance import (
    dissection_order,
    elastic_stiffness,
    node_adjacency,
)
from softprint.runtime.mesh import Mesh


class RestResponse:
    """Displacements of a body of one material whose nodes `held` do not move, at a Young's modulus of 1 Pa: those at E
    are smaller by that factor."""

    def __init__(self, mesh: Mesh, held: IntArray, poisson: float) -> None:
        self._mesh = mesh
        free = np.setdiff1d(np.arange(mesh.n_nodes), held)
        self._free = free[dissection_order(mesh.points[free], node_adjacency(mesh)[free][:, free])]
        unknowns = (self._free[:, None] * mesh.dim + np.arange(mesh.dim)).ravel()
        each = np.ones(mesh.n_cells)
        material = make_material("stable_neo_hookean", each, poisson * each)
        self._factor = splu(
            elastic_stiffness(mesh, material)[unknowns][:, unknowns].tocsc(),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def displacement(self, forces: Array) -> Array:
        """(n_nodes, dim, k) [m] of k sets of nodal forces (n_nodes, dim, k) [N]."""
        result = np.zeros_like(forces)
        loads = np.ascontiguousarray(forces[self._free]).reshape(-1, forces.shape[2])
        result[self._free] = self._factor.solve(loads).reshape(len(self._free), -1, forces.shape[2])
        return result

    def sag(self, specific_weight: float) -> float:
        """The largest displacement [m] by the body's own weight [N/m^3]."""
        weight = np.zeros((self._mesh.n_nodes, self._mesh.dim, 1))
        weight[:, -1, 0] = -specific_weight * self._mesh.node_volumes
        return float(np.linalg.norm(self.displacement(weight), axis=1).max())

    def giving_way(self, places: IntArray, radius: float) -> Array:
        """(n,) [m/N] how far the surface around surface nodes (n,) moves with a unit force against their normals,
        spread over what is nearer than the radius [m]."""
        mesh = self._mesh
        surface = mesh.points[mesh.surface_nodes]
        patches = np.zeros((mesh.n_nodes, mesh.dim, len(places)))
        for number, place in enumerate(places):
            normal = mesh.surface_normals[np.searchsorted(mesh.surface_nodes, place)]
            near = np.linalg.norm(surface - mesh.points[place], axis=1) <= radius
            share = near * mesh.surface_areas / mesh.surface_areas[near].sum()
            patches[mesh.surface_nodes, :, number] = -share[:, None] * normal
        moved = self.displacement(patches)
        return np.asarray((patches * moved).sum(axis=(0, 1)))
