"""A displacement that is linear in amplitudes a (K,) of modes m_k, and in the handle rows.

    u = F(q) sum_k a_k m_k - U_p c,    c = W F(q) sum_k a_k m_k,

with F the deformation gradient of the subspace at the nodes (thesis eq. 4.1), U_p the columns of the basis that belong
to point handles, and W x the rows of the points in a projection of positions x (`ReducedBody.point_projection`). F m_k
alone moves the points of a state: the second term takes that back, so that the reduced state of U q + u is q. Both
terms are products of rows and amplitudes, with c = (T a) rows, T_psk = sum_n W_pn G_ns . m_kn.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.internal.correction import times_each
from softprint.runtime.learned.internal.equilibrium.mode_kernels import along_modes, summed

Singles = NDArray[np.float32]


class ModeField:
    """u at n nodes. modes: m (n, dim, K) in single precision; by_row: G (n, dim, n_rows) [1/m]; points: U_p (n,
    n_points); taken_back: T (n_points, n_rows, K)."""

    def __init__(self, modes: Singles, by_row: Array, points: Array, taken_back: Array) -> None:
        self.modes, self.by_row, self.points, self.taken_back = modes, by_row, points, taken_back

    @classmethod
    def of(cls, body: ReducedBody, modes: Array) -> ModeField:
        """At all nodes of a body; modes: (K, n_nodes, dim)."""
        gradient, n_points = basis_gradient_at_nodes(body), body.handles.n_points
        moved = np.empty((0, body.n_rows, len(modes)))
        if n_points:
            products = gradient @ modes.transpose(1, 2, 0)  # G_ns . m_kn
            moved = body.point_projection @ products.reshape(body.n_nodes, -1)
        by_row = np.ascontiguousarray(gradient.transpose(0, 2, 1))
        points = np.ascontiguousarray(body.basis[:, :n_points])
        own = np.ascontiguousarray(modes.transpose(1, 2, 0), dtype=np.float32)
        return cls(own, by_row, points, moved.reshape(n_points, body.n_rows, len(modes)))

    @property
    def count(self) -> int:
        """K."""
        return self.modes.shape[2]

    def some(self, nodes: IntArray) -> ModeField:
        """u at some of the nodes (m,)."""
        other = copy(self)
        other.modes, other.by_row = self.modes[nodes], self.by_row[nodes]
        other.points = self.points[nodes]
        return other

    def moments(self, mass: Array) -> Array:
        """sum_n mass_n u_n = rows^T (M a): M (n_rows, K) [kg]; mass: of the nodes (n,) [kg]."""
        n, dim, n_rows = self.by_row.shape
        weighted = (mass[:, None, None] * self.modes).reshape(n * dim, -1)
        direct = self.by_row.reshape(n * dim, n_rows).T @ weighted
        return np.asarray(direct - np.tensordot(mass @ self.points, self.taken_back, axes=1))

    def at(self, rows: Array) -> RowModes:
        """u as a linear function of the amplitudes, at handle rows (n_rows, dim)."""
        n, dim, n_rows = self.by_row.shape
        return RowModes(self, rows, (self.by_row.reshape(n * dim, n_rows) @ rows).reshape(n, dim, dim))

    def row_forces(self, a: Array, forces: Array) -> Array:
        """sum_n f_n . du_n/drows (n_rows, dim) [N] of forces f (n, dim) [N], with the amplitudes fixed."""
        n, dim, n_rows = self.by_row.shape
        both = (self.sum(a)[:, :, None] * forces[:, None, :]).reshape(-1, dim)
        taken = self.points_moved(a).T @ (self.points.T @ forces)
        return np.asarray(self.by_row.reshape(n * dim, n_rows).T @ both - taken)

    def row_along(self, a: Array, directions: Array) -> Singles:
        """du (n*dim, k) along directions (n_rows*dim, k) of the rows, with the amplitudes fixed."""
        n, dim, n_rows = self.by_row.shape
        by_rows = (self.sum(a)[:, None, :] @ self.by_row)[:, 0] - self.points @ self.points_moved(a)
        moved = by_rows.astype(np.float32) @ directions.reshape(n_rows, -1).astype(np.float32)
        return np.asarray(moved.reshape(n * dim, -1))

    def mixed(self, forces: Array) -> Singles:
        """sum_n f_n . d2u_n/drows da (n_rows*dim, K) of forces f (n, dim) [N]."""
        n, dim, n_rows = self.by_row.shape
        by_row = self.by_row.reshape(n * dim, n_rows).astype(np.float32)
        modes, single = self.modes, forces.astype(np.float32)
        found = np.empty((n_rows, dim, self.count), dtype=np.float32)
        for axis in range(dim):
            found[:, axis] = by_row.T @ (single[:, axis, None, None] * modes).reshape(n * dim, -1)
        found -= np.tensordot((self.points.T @ forces).T, self.taken_back, axes=1).swapaxes(0, 1)
        return found.reshape(n_rows * dim, -1)

    def sum(self, a: Array) -> Array:
        """sum_k a_k m_k (n, dim)."""
        n, dim, count = self.modes.shape
        return summed(self.modes.reshape(n * dim, count), a).reshape(n, dim)

    def points_moved(self, a: Array) -> Array:
        """T a (n_points, n_rows)."""
        return np.asarray(self.taken_back @ a)


@dataclass(frozen=True, eq=False)
class RowModes:
    """u at handle rows (n_rows, dim), linear in the amplitudes a (K,). turned: F^T (n, dim, dim)."""

    field: ModeField
    rows: Array
    turned: Array

    def displacement(self, a: Array) -> Array:
        """u (n, dim) [m]."""
        own = times_each(self.turned, self.field.sum(a))
        return own - self.field.points @ (self.field.points_moved(a) @ self.rows)

    @lazy
    def by_amplitude(self) -> Singles:
        """du/da (n*dim, K), in single precision: for Hessians."""
        field = self.field
        found = self.turned.astype(np.float32).transpose(0, 2, 1) @ field.modes
        if field.points.shape[1]:
            moved = np.einsum("psk,si->pik", field.taken_back, self.rows).astype(np.float32)
            found -= np.tensordot(field.points.astype(np.float32), moved, axes=1)
        return found.reshape(-1, field.count)

    def forces(self, forces: Array) -> Array:
        """sum_n f_n . du_n/da (K,) of forces f (n, dim) [N]."""
        field = self.field
        local = times_each(np.ascontiguousarray(self.turned.transpose(0, 2, 1)), forces)
        of_points = (field.points.T @ forces) @ self.rows.T
        taken = field.taken_back.reshape(-1, field.count).T @ of_points.ravel()
        return along_modes(field.modes.reshape(-1, field.count), local.ravel()) - taken
