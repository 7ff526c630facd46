"""The strain that contact forces cause in cells at the contact nodes: the displacement gradient of linear mechanics.

Forces phi_j on contact nodes, at rest, displace the nodes of the mesh by u_X = sum_j G_Xj phi_j
(`runtime/mechanics/compliance/surface_compliance.py`). In two cells at each contact node i, the largest that it is a
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
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.compiled import compiled
from softprint.runtime.elasticity.materials import Material, make_material
from softprint.runtime.lazy import lazy
from softprint.runtime.mechanics.compliance.surface_compliance import CsrParts, SurfaceCompliance, csr_parts
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

    def among(self, nodes: IntArray) -> Array:
        """D (m, CELLS, dim, dim, m, dim) among some of the contact nodes (m,), ascending."""
        return blocks_among(nodes, self.starts, self.others, self.blocks)


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


def _dense_blocks(
    starts: IntArray,
    others: IntArray,
    corners: IntArray,
    gradients: Array,
    operator: NDArray[np.float32],
    share: CsrParts,
    near: CsrParts,
) -> NDArray[np.float32]:
    """From the whole of G^T."""
    n_anchors, dim, n_nodes, _ = operator.shape
    n = len(starts) - 1
    P = csr_matrix(share[::-1], shape=(n, n_anchors)).toarray()
    N = csr_matrix(near[::-1], shape=(n * dim, n_nodes * dim)).toarray()
    G = np.einsum("jk,keXa->jeXa", P, operator) + N.reshape(n, dim, n_nodes, dim)
    of = np.repeat(np.arange(n), np.diff(starts))
    moved = G[others[:, None, None], :, corners[of]]
    return np.einsum("pcvea,pcvb->pcabe", moved, gradients[of]).astype(np.float32)


@compiled(reference=_dense_blocks)
def strain_blocks(
    starts: IntArray,
    others: IntArray,
    corners: IntArray,
    gradients: Array,
    operator: NDArray[np.float32],
    share: CsrParts,
    near: CsrParts,
) -> NDArray[np.float32]:
    """D (p, c, dim, dim, dim) of pairs of contact nodes. corners (n, c, v) and gradients (n, c, v, dim) of the cells at
    each; operator, share and near as in `SurfaceCompliance`, the last two as row starts, columns and entries."""
    n, cells, v, dim = gradients.shape
    blocks = np.zeros((len(others), cells, dim, dim, dim), dtype=np.float32)
    G = np.empty((dim, dim))
    for i in range(n):
        for pair in range(starts[i], starts[i + 1]):
            j = others[pair]
            first = near[0][j * dim]
            count = near[0][j * dim + 1] - first
            columns = near[1][first : first + count]
            for c in range(cells):
                for k in range(v):
                    X = corners[i, c, k]
                    G[:] = 0.0
                    for entry in range(share[0][j], share[0][j + 1]):
                        part, column = share[2][entry], operator[share[1][entry]]
                        for e in range(dim):
                            for a in range(dim):
                                G[a, e] += part * column[e, X, a]
                    # The rows of one contact node have their entries in the same columns, ascending.
                    at = np.searchsorted(columns, X * dim)
                    if at < count and columns[at] == X * dim:
                        for e in range(dim):
                            for a in range(dim):
                                G[a, e] += near[2][first + e * count + at + a]
                    for a in range(dim):
                        for b in range(dim):
                            for e in range(dim):
                                blocks[pair, c, a, b, e] += G[a, e] * gradients[i, c, k, b]
    return blocks


def _looked_up(nodes: IntArray, starts: IntArray, others: IntArray, blocks: NDArray[np.float32]) -> Array:
    m, (_, cells, dim, _, _) = len(nodes), blocks.shape
    found = np.zeros((m, cells, dim, dim, m, dim))
    for r, i in enumerate(nodes):
        known = {j: k for k, j in enumerate(others[starts[i] : starts[i + 1]], starts[i])}
        for s, j in enumerate(nodes):
            if j in known:
                found[r, :, :, :, s] = blocks[known[j]]
    return found


@compiled(reference=_looked_up)
def blocks_among(nodes: IntArray, starts: IntArray, others: IntArray, blocks: NDArray[np.float32]) -> Array:
    """D (m, c, dim, dim, m, dim) among some of the contact nodes (m,), ascending; zero where two are not near."""
    m, cells, dim = len(nodes), blocks.shape[1], blocks.shape[2]
    found = np.zeros((m, cells, dim, dim, m, dim))
    for r in range(m):
        pair, last = starts[nodes[r]], starts[nodes[r] + 1]
        for s in range(m):
            while pair < last and others[pair] < nodes[s]:
                pair += 1
            if pair == last:
                break
            if others[pair] == nodes[s]:
                for c in range(cells):
                    for a in range(dim):
                        for b in range(dim):
                            for e in range(dim):
                                found[r, c, a, b, s, e] = blocks[pair, c, a, b, e]
    return found
