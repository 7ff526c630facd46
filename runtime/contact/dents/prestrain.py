"""The strain of the body in which a dent is made: at the contact nodes, without the dent.

It is that of the reduced positions with static condensation (`runtime/mechanics/static_condensation.py`), a mean over
the largest cells that the node is a corner of. With the rotation R_i of the body at the node fixed at the frame rows,
the deformation gradient is affine in the handle rows q,

    R_i^T F_i = I + M_i (R_i^T q - q_rest) + B_i R_i^T g,    M_i = mean over c of grad U + sum_v L_v (x) grad N_v,
    B_i = mean over c of sum_v w_v (x) grad N_v,

with the modes L and w of the corners v of the cells, and so is not its strain. With that of Green, A = (F^T F - I) / 2,
that of Biot, (F^T F)^(1/2) - I, is to second order

    E = A - A^2 / 2,    dE = dA - sym(A dA),    d2E = d2A - sym(A d2A) - sym(dA dA'),
    dA = sym(F^T dF),    d2A = sym(dF^T dF').

M_i does not know of translations. Rotating the body with the frame rows changes nothing. An internal correction of the
body has no part in E.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.handles import centred
from softprint.runtime.lazy import lazy
from softprint.runtime.linalg.sparse_directions import times_directions
from softprint.runtime.mechanics.compliance.surface_compliance import SurfaceCompliance
from softprint.runtime.mechanics.corotation import Corotation
from softprint.runtime.mechanics.static_condensation import StaticCondensation
from softprint.runtime.mesh.mesh import Mesh

# The cells of a node that the mean is over.
_CELLS = 4
# Contact nodes whose modes are computed at once.
_AT_ONCE = 250


@dataclass(frozen=True, eq=False)
class Prestrain:
    """Of n contact nodes. modes: M (n, dim^2, n_rows*dim) [1/m], and weight: B (n, dim^2, dim) [s^2/m]; gradients: (n,
    dim, n_rows) [1/m] of the rotations, None for a body without static condensation, whose F needs none; rest_rows:
    (n_rows, dim) [m]; affine_part: see `Handles.affine_part`; gravity: (dim,) [m/s^2]."""

    modes: NDArray[np.float32]
    weight: NDArray[np.float32]
    gradients: NDArray[np.floating[Any]] | None
    rest_rows: Array
    affine_part: Array
    gravity: Array

    @classmethod
    def of(
        cls, body: ReducedBody, compliance: SurfaceCompliance, condensation: StaticCondensation | None
    ) -> Prestrain:
        """At the contact nodes of the compliance of a body. Its modes are kept as long as the compliance, as all
        colliders on the body share them."""
        kept, settled = _KEPT.setdefault(compliance, {}), condensation is not None
        if settled not in kept:
            kept[settled] = cls._computed(body, compliance.nodes, condensation)
        return kept[settled] if condensation is None else replace(kept[settled], gravity=condensation.gravity)

    @classmethod
    def _computed(
        cls, body: ReducedBody, nodes: IntArray, condensation: StaticCondensation | None
    ) -> Prestrain:
        dim, size, mesh = body.dim, body.n_rows * body.dim, body.mesh
        modes = np.empty((len(nodes), dim * dim, size), dtype=np.float32)
        weight = np.zeros((len(nodes), dim * dim, dim), dtype=np.float32)
        for first in range(0, len(nodes), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            cells, volumes = largest_cells(mesh, nodes[part])
            corners = mesh.cells[cells].reshape(len(cells), -1)
            share = (volumes / volumes.sum(axis=1, keepdims=True))[:, :, None, None]
            slopes = (share * mesh.cell_gradients[cells]).reshape(len(cells), -1, dim)
            by_rows = np.einsum("nvr,ad->nvard", body.basis[corners], np.eye(dim))
            if condensation is not None:
                by_rows += condensation.modes[corners]
                by_gravity = np.einsum("nvad,nvb->nabd", condensation.weight[corners], slopes)
                weight[part] = by_gravity.reshape(-1, dim * dim, dim)
            by_axis = by_rows.reshape(*corners.shape, dim * size).swapaxes(1, 2) @ slopes
            by_axis = by_axis.reshape(-1, dim, size, dim).swapaxes(2, 3)
            modes[part] = by_axis.reshape(-1, dim * dim, size)
        gradients = None if condensation is None else condensation.rotation_gradients[nodes]
        return cls(modes, weight, gradients, body.rest_rows, body.handles.affine_part, np.zeros(dim))

    def at(self, nodes: IntArray, rows: Array, frame_rows: Array) -> NodePrestrain:
        """At some of the contact nodes (m,), at handle rows in a step that starts at frame rows (n_rows, dim)."""
        if self.gradients is None:
            rotations = np.broadcast_to(np.eye(rows.shape[1]), (len(nodes), *2 * rows.shape[1:]))
        else:
            rotations = Corotation(self.gradients[nodes], self.affine_part).rotations(frame_rows)
        return NodePrestrain(self, nodes, rows, rotations)

    @lazy
    def centred_rest_rows(self) -> Array:
        """q_rest without its mean translation (n_rows, dim) [m]."""
        return centred(self.rest_rows, self.affine_part)


@dataclass(frozen=True, eq=False)
class NodePrestrain:
    """At some of the contact nodes (m,), in the frame of a step. rows: q (n_rows, dim); rotations: R (m, dim, dim)."""

    of: Prestrain
    nodes: IntArray
    rows: Array
    rotations: Array

    @lazy
    def value(self) -> Array:
        """E (m, dim^2)."""
        A = self.green
        return np.asarray((A - 0.5 * A @ A).reshape(len(A), -1))

    @lazy
    def green(self) -> Array:
        """A (m, dim, dim)."""
        return np.asarray(0.5 * (np.swapaxes(self.F, 1, 2) @ self.F - np.eye(self.F.shape[1])))

    def by_green(self, by_strain: Array) -> Array:
        """What there is by A (m, dim, dim), symmetric, of what there is by E (m, dim^2)."""
        T, A = _symmetric(by_strain.reshape(self.green.shape)), self.green
        return T - _symmetric(A @ T)

    def pulled_back(self, by_strain: Array) -> Array:
        """sum_i T_i : dE_i/drows (n_rows, dim) of T (m, dim^2)."""
        by_F = self.F @ self.by_green(by_strain)
        by_rows = (by_F.reshape(len(by_F), 1, -1) @ self._modes).reshape(-1, *self.rows.shape)
        return np.asarray((by_rows @ self.rotations.swapaxes(1, 2)).sum(axis=0))

    def motions(self, along: Array | None = None) -> StrainMotions:
        """By the rows; along: see `RowHessian`."""
        n_rows, dim = self.rows.shape
        by_rows = self._modes.reshape(len(self.nodes), -1, dim) @ self.rotations.swapaxes(1, 2)
        flat = by_rows.reshape(-1, n_rows * dim)
        dF = flat if along is None else times_directions(flat, along)
        return StrainMotions(self, dF.reshape(len(self.nodes), dim, dim, -1))

    @lazy
    def F(self) -> Array:
        """R^T F (m, dim, dim)."""
        of, R = self.of, self.rotations
        moved = centred(self.rows, of.affine_part) @ R - of.centred_rest_rows
        by_rows = self._modes @ moved.reshape(len(R), -1, 1)
        by_gravity = of.weight[self.nodes] @ (of.gravity @ R)[..., None]
        return np.asarray(np.eye(R.shape[1]) + (by_rows + by_gravity).reshape(R.shape))

    @lazy
    def _modes(self) -> NDArray[np.float32]:
        return self.of.modes[self.nodes]


@dataclass(frozen=True, eq=False)
class StrainMotions:
    """n motions of m contact nodes. dF: (m, dim, dim, n) of their deformation gradients, in the frame of a step."""

    of: NodePrestrain
    dF: Array

    @lazy
    def strain(self) -> Array:
        """dE (m, dim^2, n)."""
        m, dim, _, n = self.dF.shape
        turned = (self.of.green @ self._green.reshape(m, dim, dim * n)).reshape(self.dF.shape)
        return np.asarray((self._green - _symmetric(turned)).reshape(m, dim * dim, n))

    def bending(self, by_strain: Array) -> Array:
        """sum_i T_i : d2E_i (n, n) of T (m, dim^2)."""
        m, dim, _, n = self.dF.shape
        T = _symmetric(by_strain.reshape(m, dim, dim))
        found = _between(self.dF, self.of.by_green(by_strain)[:, None] @ self.dF)
        return found - _between(self._green, (T @ self._green.reshape(m, dim, dim * n)).reshape(self.dF.shape))

    @lazy
    def _green(self) -> Array:
        """dA (m, dim, dim, n)."""
        m, dim, _, n = self.dF.shape
        return _symmetric((self.of.F.swapaxes(1, 2) @ self.dF.reshape(m, dim, dim * n)).reshape(self.dF.shape))


def largest_cells(mesh: Mesh, nodes: IntArray) -> tuple[IntArray, Array]:
    """(n, 4) the largest of the cells that each node (n,) is a corner of, and their volumes [m^dim]; where there are
    fewer, the smallest again, with no volume."""
    corners = mesh.cells.ravel()
    of = np.repeat(np.arange(len(mesh.cells)), mesh.cells.shape[1])
    order = np.lexsort((-mesh.cell_volumes[of], corners))
    first, last = (np.searchsorted(corners[order], nodes, side) for side in ("left", "right"))
    place = first[:, None] + np.arange(_CELLS)
    cells = of[order][np.minimum(place, last[:, None] - 1)]
    return cells, np.where(place < last[:, None], mesh.cell_volumes[cells], 0.0)


def _symmetric(M: Array) -> Array:
    """In the second and third axis (m, dim, dim, ...)."""
    return np.asarray(0.5 * (M + M.swapaxes(1, 2)))


def _between(one: Array, other: Array) -> Array:
    """sum one : other (n, n) of (m, dim, dim, n) each."""
    n = one.shape[3]
    return np.asarray(one.reshape(-1, n).T @ other.reshape(-1, n))


_KEPT: WeakKeyDictionary[SurfaceCompliance, dict[bool, Prestrain]] = WeakKeyDictionary()
