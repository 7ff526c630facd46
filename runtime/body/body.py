"""The reduced body: a mesh, its handles and basis, its material, and what dynamics needs of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from runtime.arrays import Array, IntArray
from runtime.body.cubature import Cubature
from runtime.body.handles import Handles
from runtime.body.material_points import MaterialPoints
from runtime.body.surface_distance import nearest_surface
from runtime.body.surface_samples import SurfaceSamples
from runtime.elasticity.materials import Material
from runtime.files import content_hash
from runtime.mesh import Mesh


@dataclass(frozen=True, eq=False)
class ReducedBody:
    """A soft body and its subspace: reduced positions are x = U rows (thesis eq. 4.1 without correction).

    basis: U (n_nodes, n_rows); material: parameters for each cell; density: (n_cells,) [kg/m^dim];
    node_mass: (n_nodes,) lumped [kg]; reduced_mass: (n_rows, n_rows) = U^T diag(node_mass) U [kg]. In 2D
    the body is one metre thick: masses are kg per metre, energies J per metre.
    """

    mesh: Mesh
    handles: Handles
    basis: Array
    material: Material
    density: Array
    node_mass: Array
    reduced_mass: Array
    cubature: Cubature
    surface: SurfaceSamples
    name: str

    @property
    def dim(self) -> int:
        return self.mesh.dim

    @property
    def n_nodes(self) -> int:
        return self.mesh.n_nodes

    @property
    def n_rows(self) -> int:
        return self.handles.n_rows

    @property
    def n_dofs(self) -> int:
        return self.handles.n_dofs

    @cached_property
    def content_hash(self) -> str:
        """Names the body by what defines it: mesh, handles, basis kind, material and density.

        Cubature and surface samples are left out (a truth file stays valid when they change), and so are
        numbers that follow from these and may differ in the last digit between machines.
        """
        content: dict[str, object] = {
            "points": self.mesh.points,
            "cells": self.mesh.cells,
            "handle_points": self.handles.points,
            "basis_kind": "biharmonic generalised barycentric coordinates",
            "model": self.material.model,
            "young": self.material.young,
            "poisson": self.material.poisson,
            "density": self.density,
        }
        for index, frame in enumerate(self.handles.frames):
            content[f"frame_{index}_{frame.name}"] = frame.nodes
        return content_hash(content)

    @cached_property
    def rest_rows(self) -> Array:
        """(n_rows, dim) handle rows at rest."""
        return self.handles.rest_rows(self.mesh.points)

    def reduced_positions(self, rows: Array) -> Array:
        """(n_nodes, dim) x = U rows [m]."""
        return self.basis @ rows

    @cached_property
    def _gram(self) -> tuple[Array, bool]:
        return cho_factor(self.basis.T @ self.basis)

    def project(self, positions: Array) -> Array:
        """Rows whose reduced positions are nearest to positions (n_nodes, dim), node by node (thesis 4.3.2).

        So U^T (x - U rows) = 0: positions and rows belong to the same reduced state. Frames come out affine;
        :meth:`Handles.rigid` makes them rigid.
        """
        return cho_solve(self._gram, self.basis.T @ positions)

    @cached_property
    def nodes_as_points(self) -> MaterialPoints:
        """All nodes as material points, computed once."""
        gradient = np.stack([derivative @ self.basis for derivative in self.mesh.nodal_gradient], axis=-1)
        distance, normal = nearest_surface(self.mesh)
        return MaterialPoints(self.mesh.points, self.basis, gradient, distance, normal)

    def node_points(self, nodes: IntArray | None = None) -> MaterialPoints:
        """The given nodes (all by default) as the points of a correction."""
        return self.nodes_as_points if nodes is None else self.nodes_as_points.take(nodes)
