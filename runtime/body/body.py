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
from runtime.io.files import content_hash
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

    @property
    def constraint_basis(self) -> Array:
        """C (n_nodes, n_points): the columns of U that a displacement beyond the reduced state must not feel,
        C^T (x - U rows) = 0 on the nodes outside rigid frames.

        The thesis (5.3.3) takes all columns of U. But those of a frame are affine modes, of which a rigid frame follows
        the rigid motions only: kept out of all of them, a body could not strain along the others at all. With the
        columns of point handles, U rows + u is any deformation of the body, and each of them once.
        """
        return self.basis[:, : self.handles.n_points]

    @cached_property
    def _free(self) -> IntArray:
        return np.setdiff1d(np.arange(self.n_nodes), self.handles.frame_nodes)

    @cached_property
    def _gram(self) -> tuple[Array, bool]:
        free = self.constraint_basis[self._free]
        return cho_factor(free.T @ free)

    def project(self, positions: Array) -> Array:
        """The reduced state of positions (n_nodes, dim) (thesis 4.3.2): frames where their nodes are, made rigid, and
        points such that C^T (x - U rows) = 0 on the other nodes, see :attr:`constraint_basis`."""
        rows = np.zeros((self.n_rows, self.dim))
        for frame in self.handles.frames:
            rest = np.column_stack([self.mesh.points[frame.nodes], np.ones(len(frame.nodes))])
            rows[self.handles.rows_of(frame.name)] = np.linalg.lstsq(
                rest, positions[frame.nodes], rcond=None
            )[0]
        rows = self.handles.rigid(rows)
        if self.handles.n_points:
            left = (positions - self.reduced_positions(rows))[self._free]
            rows[: self.handles.n_points] = cho_solve(self._gram, self.constraint_basis[self._free].T @ left)
        return rows

    @cached_property
    def nodes_as_points(self) -> MaterialPoints:
        """All nodes as material points, computed once."""
        gradient = np.stack([derivative @ self.basis for derivative in self.mesh.nodal_gradient], axis=-1)
        distance, normal = nearest_surface(self.mesh)
        return MaterialPoints(self.mesh.points, self.basis, gradient, distance, normal)

    def node_points(self, nodes: IntArray | None = None) -> MaterialPoints:
        """The given nodes (all by default) as the points of a correction."""
        return self.nodes_as_points if nodes is None else self.nodes_as_points.take(nodes)
