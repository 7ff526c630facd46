"""The strain that contact forces cause in cells at the contact nodes: the displacement gradient of linear mechanics.

Forces phi_j on contact nodes, at rest, displace the nodes of the mesh by u_X = sum_j G_Xj phi_j
(`runtime/mechanics/compliance/surface_compliance.py`). In some cells at each contact node i, the largest that it is a
corner of,

    H_ic = sum_v u_v (x) grad N_v = sum_j D_icj phi_j.

D is kept for pairs of contact nodes that are near each other: strain falls off with the square of the distance, and on
the small Jelly a reach of four distances between contact nodes tells nearly as much as all of them. So neither memory
nor time grow with the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.dents.dent_strain_kernels import (
    forces_by,
    near_among,
    strain_blocks,
    strains_by,
)
from softprint.runtime.elasticity.materials import Material, make_material
from softprint.runtime.elasticity.strained_stiffness import StrainedStiffness
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance, csr_parts
from softprint.runtime.mesh.mesh import Mesh

#: Cells at each contact node. With two, a cone (tip of 2 mm, nodes 3.6 mm apart) meets a tenth more force where it is
#: pressed in deep; six tell no more.
CELLS = 4
# How far forces are felt, in mean distances between contact nodes.
_REACH = 4.0


@dataclass(frozen=True, eq=False)
class DentStrain:
    """D of the contact nodes of a body, n of them. volumes: (n, CELLS) [m^dim] of the cells, 0 for what stands there
    where a node has fewer; material: of the cells (n*CELLS,), finite for any strain; starts: (n + 1,) and others: (p,),
    the contact nodes near each, ascending; blocks: (p, CELLS, dim, dim, dim) [1/N], by cell, the axis of u, that of its
    gradient and that of the force."""

    volumes: Array
    material: Material
    starts: IntArray
    others: IntArray
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
        cells, volumes = largest_cells(mesh, nodes)
        spacing = (compliance.areas.sum() / len(nodes)) ** (1.0 / (mesh.dim - 1))
        rest = mesh.points[nodes]
        near = [np.sort(others) for others in cKDTree(rest).query_ball_point(rest, _REACH * spacing)]
        starts = np.concatenate([[0], np.cumsum([len(others) for others in near])])
        others = np.concatenate(near)
        at = mesh.cells[cells], np.ascontiguousarray(mesh.cell_gradients[cells])
        parts = csr_parts(compliance.share), csr_parts(compliance.near)
        blocks = strain_blocks(starts, others, *at, compliance.operator, *parts)
        return cls(volumes, _finite(body.material, cells.ravel()), starts, others, blocks)

    @lazy
    def linear(self) -> Material:
        """Linear elasticity with the moduli of the cells (n*CELLS,)."""
        return make_material("linear", self.material.young, self.material.poisson)

    @lazy
    def strained(self) -> StrainedStiffness:
        """How their stiffness changes with their strain."""
        return StrainedStiffness.of(self.material, self.blocks.shape[2])

    def among(self, nodes: IntArray) -> StrainAmong:
        """D among some of the contact nodes (m,), ascending."""
        blocks = self.blocks.reshape(len(self.blocks), -1, self.blocks.shape[-1])
        return StrainAmong(*near_among(nodes, self.starts, self.others), blocks)


@dataclass(frozen=True, eq=False)
class StrainAmong:
    """D among m contact nodes. starts: (m + 1,) and others: (q,), those near each, by their places among these; pairs:
    (q,) their places in the blocks (p, CELLS dim^2, dim) [1/N]."""

    starts: IntArray
    others: IntArray
    pairs: IntArray
    blocks: NDArray[np.float32]

    def strains(self, forces: Array) -> Array:
        """H (m, CELLS dim^2, n) by forces (m*dim, n) [N]."""
        by_node = np.ascontiguousarray(forces).reshape(len(self.starts) - 1, -1, forces.shape[1])
        return strains_by(self.starts, self.others, self.pairs, self.blocks, by_node)

    def pulled_back(self, by_strain: Array) -> Array:
        """D^T of what there is by strain (m, CELLS dim^2, n): by force (m, dim, n)."""
        return forces_by(self.starts, self.others, self.pairs, self.blocks, by_strain)


_KEPT: WeakKeyDictionary[SurfaceCompliance, DentStrain] = WeakKeyDictionary()


def largest_cells(mesh: Mesh, nodes: IntArray) -> tuple[IntArray, Array]:
    """(n, CELLS) the largest of the cells that each node (n,) is a corner of, and their volumes [m^dim]; where there
    are fewer, the smallest again, with no volume."""
    corners = mesh.cells.ravel()
    of = np.repeat(np.arange(len(mesh.cells)), mesh.cells.shape[1])
    order = np.lexsort((-mesh.cell_volumes[of], corners))
    first, last = (np.searchsorted(corners[order], nodes, side) for side in ("left", "right"))
    place = first[:, None] + np.arange(CELLS)
    cells = of[order][np.minimum(place, last[:, None] - 1)]
    return cells, np.where(place < last[:, None], mesh.cell_volumes[cells], 0.0)


def _finite(material: Material, cells: IntArray) -> Material:
    """The material of some cells (n,), or one with the same moduli that is finite for any strain."""
    model = material.model if material.finite_if_inverted else "stable_neo_hookean"
    return make_material(model, _modulus(material.young, cells), _modulus(material.poisson, cells))


def _modulus(of: Array, cells: IntArray) -> Array:
    """Of some cells (n,), a scalar where it is the same in all: what follows from it is then computed once."""
    own = of[cells] if of.ndim else of
    return own.ravel()[0] if own.size and (own == own.ravel()[0]).all() else own
