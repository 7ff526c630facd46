"""The reduced body: a mesh, its handles and basis, its material, and the quantities that dynamics needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.body.surface_distance import nearest_surface
from softprint.runtime.body.surface_samples import SurfaceSamples
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.elasticity.reduced_elasticity import ReducedElasticity
from softprint.runtime.io.files import content_hash
from softprint.runtime.mesh import Mesh

if TYPE_CHECKING:
    from softprint.runtime.body.appearance import Shown
    from softprint.runtime.colliders.pose import RigidPose
    from softprint.runtime.drawing.picture import Picture

#: How handles move the nodes, and what a body's hash calls it.
SUBSPACES = {
    "biharmonic_coordinates": "biharmonic generalised barycentric coordinates",
    "linear_blend_skinning": "linear blend skinning, bounded biharmonic weights",
}
#: How a state is held, see `ReducedBody.constraint_basis`.
HOLDS = ("projection", "mass", "nodes")


@dataclass(frozen=True, eq=False)
class ReducedBody:
    """A soft body and its subspace: reduced positions are x = U rows (thesis eq. 4.1 without correction).

    basis: U (n_nodes, n_rows); subspace: its kind, a key of `SUBSPACES`; hold: how a state is held, see
    `constraint_basis`; material: parameters for each cell; density: (n_cells,) [kg/m^dim]; node_mass: (n_nodes,) lumped
    [kg]; reduced_mass: (n_rows, n_rows) = U^T diag(node_mass) U [kg]. In 2D the body is one metre thick: masses are kg
    per metre, energies J per metre.
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
    subspace: str = "biharmonic_coordinates"
    hold: str = "mass"

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
        """Identifies the body by what defines it: mesh, handles, basis kind, material and density.

        Cubature and surface samples are left out (a truth file stays valid when they change). So are derived numbers,
        which may differ in the last digit between machines.
        """
        content: dict[str, object] = {
            "points": self.mesh.points,
            "cells": self.mesh.cells,
            "handle_points": self.handles.points,
            "basis_kind": SUBSPACES[self.subspace],
            "model": self.material.model,
            "young": self.material.young,
            "poisson": self.material.poisson,
            "density": self.density,
        }
        if self.hold != "projection":
            content["hold"] = self.hold
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
    def reduced_elasticity(self) -> ReducedElasticity:
        """The elastic energy of the handle rows, on the cubature cells."""
        cells, weights = self.cubature.cells, self.cubature.weights
        return ReducedElasticity.on_cells(self.mesh, self.basis, self.material, cells, weights)

    def show(
        self,
        positions: Array | None = None,
        colliders: Sequence[Shown] = (),
        poses: Mapping[str, RigidPose] | None = None,
    ) -> Picture:
        """A picture, which a notebook shows: the body at rest with its handles, or at positions (n_nodes, dim) [m],
        coloured by its displacement, with the colliders that poses has one for.

            body.show(simulator.positions(state), simulator.colliders, state.poses)

        Raises SoftprintError if no pictures can be drawn here.
        """
        from softprint.runtime.body.appearance import deformed_scene, handles_scene
        from softprint.runtime.drawing.draw import picture

        if positions is None:
            return picture(handles_scene(self.name, self.mesh, self.handles))
        return picture(deformed_scene(self.name, self.mesh, positions, colliders, poses or {}))

    @cached_property
    def constraint_basis(self) -> Array:
        """C (n_nodes, n_points): what holds a state while the rest of the body settles: C^T (x - U rows) = 0 on the
        nodes outside rigid frames, which are fixed themselves.

        With hold = "projection", C is the columns of U that belong to point handles. The thesis (5.3.3) takes all
        columns of U. But the columns of a frame are affine modes, and a rigid frame only follows the rigid motions
        among them. Constraining all of them would forbid every strain along the other affine modes. With the columns of
        point handles alone, U rows + u represents every deformation of the body exactly once.

        With hold = "mass", these columns are weighted by the masses of the nodes, C = M U: what settles, u, then has no
        momentum along the handles, U^T M u = 0, so that the inertia of u is of second order and the slowest frequencies
        of the reduced body are near those of the body. Nor does it matter where nodes are dense.

        With hold = "nodes", C picks the nodes of the point handles (thesis 4.3.2, chapter 4): each is fixed where the
        state has it. The force of a fixed node is a point load, so its displacement depends on the size of the cells.
        """
        of_points = self.basis[:, : self.handles.n_points]
        if self.hold == "projection":
            return of_points
        if self.hold == "mass":
            return self.node_mass[:, None] / self.node_mass.mean() * of_points
        picked = np.zeros((self.n_nodes, self.handles.n_points))
        picked[self.handles.points, np.arange(self.handles.n_points)] = 1.0
        return picked

    @cached_property
    def _free(self) -> IntArray:
        return np.setdiff1d(np.arange(self.n_nodes), self.handles.frame_nodes)

    @cached_property
    def _gram(self) -> tuple[Array, bool]:
        """C^T U on the free nodes, of the columns of points: symmetric, and the identity where nodes are fixed."""
        free, n_points = self.constraint_basis[self._free], self.handles.n_points
        return cho_factor(free.T @ self.basis[self._free][:, :n_points])

    def project(self, positions: Array) -> Array:
        """The reduced state of positions (n_nodes, dim) (thesis 4.3.2): frames are fitted rigidly to their nodes, and
        points are chosen so that C^T (x - U rows) = 0 on the other nodes, see :attr:`constraint_basis`."""
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
    def point_projection(self) -> Array:
        """(n_points, n_nodes) W: W x are the rows of the points in `project`, with frames fitted affinely."""
        free, basis = self._free, self.basis[self._free]
        weights = np.zeros((self.handles.n_points, self.n_nodes))
        weights[:, free] = cho_solve(self._gram, self.constraint_basis[free].T)
        for frame in self.handles.frames:
            rest = np.column_stack([self.mesh.points[frame.nodes], np.ones(len(frame.nodes))])
            by_frame = weights[:, free] @ basis[:, self.handles.rows_of(frame.name)]
            weights[:, frame.nodes] -= by_frame @ np.linalg.pinv(rest)
        return weights

    @cached_property
    def nodes_as_points(self) -> MaterialPoints:
        """All nodes as material points, computed once."""
        gradient = np.stack([derivative @ self.basis for derivative in self.mesh.nodal_gradient], axis=-1)
        distance, normal = nearest_surface(self.mesh)
        return MaterialPoints(self.mesh.points, self.basis, gradient, distance, normal)

    def node_points(self, nodes: IntArray | None = None) -> MaterialPoints:
        """The given nodes (all by default) as the points of a correction."""
        return self.nodes_as_points if nodes is None else self.nodes_as_points.take(nodes)
