"""The strain that contact forces cause under the surface of a body: the displacement gradient of linear mechanics.

Forces phi_j on contact nodes, at rest, displace the nodes of the mesh by u_X = sum_j G_Xj phi_j
(`runtime/mechanics/compliance/surface_compliance.py`). In some cells near each contact node i,

    H_ic = sum_v u_v (x) grad N_v = sum_j D_icj phi_j.

They stand for the layer of the body that is as deep as one and a half distances between contact nodes: every cell of it
belongs to the nearest contact node. D is kept for pairs of contact nodes that are near each other: strain falls off
with the square of the distance. So neither memory nor time grow with the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, BoolArray, IntArray, scatter_sum
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.dents.dent_strain_kernels import (
    forces_by,
    near_among,
    strain_blocks,
    strains_by,
)
from softprint.runtime.elasticity.materials import Material, make_material
from softprint.runtime.elasticity.rest_derivatives import RestDerivatives
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance, csr_parts
from softprint.runtime.mesh.mesh import Mesh

#: Cells at each contact node, at most: where more belong to one, each of these stands for others as deep as it is.
CELLS = 4
# In mean distances between contact nodes: how deep the layer is, and how far around a loaded node its cells count; how
# far forces are felt.
_DEPTH, _REACH = 1.5, 4.0


class NearNodes(NamedTuple):
    """The contact nodes within some distance of each of n, itself among them. starts: (n + 1,) and others: (p,), those
    of each, ascending."""

    starts: IntArray
    others: IntArray

    @classmethod
    def within(cls, distance: float, rest: Array) -> NearNodes:
        """Of nodes at rest positions (n, dim) [m]."""
        near = [np.sort(others) for others in cKDTree(rest).query_ball_point(rest, distance)]
        return cls(np.concatenate([[0], np.cumsum([len(others) for others in near])]), np.concatenate(near))

    def of(self, nodes: IntArray) -> tuple[IntArray, BoolArray]:
        """The nodes (n,), ascending, that are near some (m,), and which are near which (n, m)."""
        count = self.starts[nodes + 1] - self.starts[nodes]
        first = np.cumsum(count) - count
        place = np.arange(count.sum()) + np.repeat(self.starts[nodes] - first, count)
        found, at = np.unique(self.others[place], return_inverse=True)
        near = np.zeros((len(found), len(nodes)), dtype=np.bool_)
        near[at, np.repeat(np.arange(len(nodes)), count)] = True
        return found, near


@dataclass(frozen=True, eq=False)
class DentStrain:
    """D of the contact nodes of a body, n of them. spacing: their mean distance [m]; counts: (n,) of the cells of each;
    volumes: (n, CELLS) [m^dim] for which they stand, 0 for what stands there where a node has fewer; material: of the
    cells (n*CELLS,); around: the nodes whose cells are near each node; near: those whose forces are felt there; blocks:
    (p, CELLS, dim, dim, dim) [1/N] by pairs, the cell, the axis of u, that of its gradient and that of the force."""

    spacing: float
    counts: IntArray
    volumes: Array
    material: Material
    around: NearNodes
    near: NearNodes
    blocks: NDArray[np.float32]

    @classmethod
    def of(cls, body: ReducedBody, compliance: SurfaceCompliance) -> DentStrain:
        """Of the contact nodes of the compliance of a body, at all its nodes. Kept as long as the compliance, as all
        colliders on the body share it."""
        if compliance not in _KEPT:
            _KEPT[compliance] = cls._computed(body, compliance)
        return _KEPT[compliance]

    @classmethod
    def _computed(cls, body: ReducedBody, compliance: SurfaceCompliance) -> DentStrain:
        mesh, nodes = body.mesh, compliance.nodes
        spacing = float((compliance.areas.sum() / len(nodes)) ** (1.0 / (mesh.dim - 1)))
        cells, volumes, counts = cells_of_layer(mesh, nodes, _DEPTH * spacing)
        around, near = (NearNodes.within(reach * spacing, mesh.points[nodes]) for reach in (_DEPTH, _REACH))
        at = mesh.cells[cells], np.ascontiguousarray(mesh.cell_gradients[cells])
        parts = csr_parts(compliance.share), csr_parts(compliance.near)
        blocks = strain_blocks(*near, *at, compliance.operator, *parts)
        return cls(spacing, counts, volumes, _of_cells(body.material, cells.ravel()), around, near, blocks)

    @lazy
    def linear(self) -> Material:
        """Linear elasticity with the moduli of the cells (n*CELLS,)."""
        return make_material("linear", self.material.young, self.material.poisson)

    @lazy
    def rest_derivatives(self) -> RestDerivatives:
        """Of the energy density of the cells."""
        return RestDerivatives.of(self.material, self.blocks.shape[2])

    def between(self, cells_of: IntArray, nodes: IntArray) -> StrainBetween:
        """D of the cells of some contact nodes (n,) by forces on some (m,), both ascending."""
        blocks = self.blocks.reshape(len(self.blocks), -1, self.blocks.shape[-1])
        size = self.counts[cells_of] * blocks.shape[1] // CELLS
        return StrainBetween(len(nodes), size, *near_among(cells_of, nodes, *self.near), blocks)


@dataclass(frozen=True, eq=False)
class StrainBetween:
    """D of the cells of n contact nodes by forces on m. sizes: (n,) the components of the strain of each that are not
    padded; starts: (n + 1,) and others: (q,), the forces that each feels, by their places; pairs: (q,) their places in
    the blocks (p, CELLS dim^2, dim) [1/N]."""

    n_forces: int
    sizes: IntArray
    starts: IntArray
    others: IntArray
    pairs: IntArray
    blocks: NDArray[np.float32]

    def strains(self, forces: Array) -> Array:
        """H (n, CELLS dim^2, c) by forces (m*dim, c) [N]."""
        by_node = np.ascontiguousarray(forces).reshape(self.n_forces, -1, forces.shape[1])
        return strains_by(self.sizes, self.starts, self.others, self.pairs, self.blocks, by_node)

    def pulled_back(self, by_strain: Array) -> Array:
        """D^T of what there is by strain (n, CELLS dim^2, c): by force (m, dim, c)."""
        own = self.sizes, self.starts, self.others, self.pairs, self.blocks
        return forces_by(self.n_forces, *own, by_strain)


_KEPT: WeakKeyDictionary[SurfaceCompliance, DentStrain] = WeakKeyDictionary()


def cells_of_layer(mesh: Mesh, nodes: IntArray, depth: float) -> tuple[IntArray, Array, IntArray]:
    """The cells whose centres are within a depth [m] of the nearest of some nodes (n,), by these: (n, CELLS) cells, the
    volumes (n, CELLS) [m^dim] for which they stand, and how many there are (n,). Where a node has more cells, they are
    put in groups by their distance, and the middle one stands for each. Where it has fewer, others stand there, without
    volume."""
    distance, owner = cKDTree(mesh.points[nodes]).query(mesh.points[mesh.cells].mean(axis=1))
    inside = np.flatnonzero(distance <= depth)
    ordered = inside[np.lexsort((distance[inside], owner[inside]))]
    of = owner[ordered]
    total = np.bincount(of, minlength=len(nodes))
    counts = np.minimum(total, CELLS)
    rank = np.arange(len(of)) - np.searchsorted(of, of)
    group = of * CELLS + rank * counts[of] // np.maximum(total[of], 1)
    size = np.bincount(group, minlength=len(nodes) * CELLS)
    first = np.searchsorted(group, np.arange(len(size)))
    cells = np.zeros(len(size), dtype=np.int64)
    cells[size > 0] = ordered[(first + size // 2)[size > 0]]
    volumes = scatter_sum(group, mesh.cell_volumes[ordered], len(size))
    return cells.reshape(-1, CELLS), volumes.reshape(-1, CELLS), counts


def _of_cells(material: Material, cells: IntArray) -> Material:
    """The material of some cells (n,)."""
    return make_material(material.model, _modulus(material.young, cells), _modulus(material.poisson, cells))


def _modulus(of: Array, cells: IntArray) -> Array:
    """Of some cells (n,), a scalar where it is the same in all: what follows from it is then computed once."""
    own = of[cells] if of.ndim else of
    return own.ravel()[0] if own.size and (own == own.ravel()[0]).all() else own
