"""The internal correction of a body: u = F(q) r(q), added to U q or to static condensation (thesis eq. 4.1).

r is a displacement in the undeformed body. The deformation gradient F of the subspace at the nodes, by moving least
squares (`runtime/body/node_gradients.py`), maps it to the world:

    x = U q + F(q) r(q),    dx/dq = U + mat(r) dF/dq + F dr/dq          (4.3).

It depends on the reduced state alone, so one correction belongs to the body, and every collider sees the corrected
body. Elastic energy and contact are taken at the corrected positions, and forces on the handles are J^T f.
"""

from __future__ import annotations

from copy import copy
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.compiled import summing
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.correction import require_body
from softprint.runtime.learned.internal.inputs import RigidFreeRows
from softprint.runtime.learned.internal.local_field import LocalField, LocalPoint, ModelField
from softprint.runtime.learned.internal.model import InternalModel, QuadraticModel
from softprint.runtime.learned.internal.weight import InternalWeight

Singles = NDArray[np.float32]
Jacobian = Literal["full", "without_gradient_change", "linear"]
JACOBIANS: tuple[Jacobian, ...] = get_args(Jacobian)


class InternalCorrection:
    """The trained correction of a body. on_condensation: whether it adds to static condensation; gravity: of its
    training, empty without; jacobian: of figure 4.4, see `MappedField`. Raises SoftprintError for a body with other
    nodes or handles."""

    def __init__(self, model: InternalModel | QuadraticModel, body: ReducedBody, jacobian: Jacobian = "full") -> None:
        require_body("internal", model.dim, model.n_rows, body)
        if model.modes.shape[1] != body.n_nodes:
            raise SoftprintError(
                f"an internal correction of {model.modes.shape[1]} nodes is used with body {body.name!r} of "
                f"{body.n_nodes}: train it for this body"
            )
        self.on_condensation = model.options.on_condensation
        self.jacobian = _known(jacobian)
        self._network, self._modes = model.as_arrays(), model.modes.double().numpy()
        self.gravity = model.options.gravity
        self._inputs = RigidFreeRows.of(body, self.gravity)
        self._gradient = basis_gradient_at_nodes(body)

    def bind(self, nodes: IntArray | None = None) -> MappedField:
        """The correction at some nodes of the body, all by default."""
        gradient = self._gradient if nodes is None else self._gradient[nodes]
        local = ModelField(self._network, self._modes, self._inputs, nodes)
        return MappedField(local, gradient, self.jacobian)

    def weight(self, mass: Array, gravity: Array) -> InternalWeight:
        """The work of gravity (dim,) [m/s^2] along the correction; mass: of every node of the body (n_nodes,) [kg]."""
        moments = np.einsum("n,nsj,knj->ks", mass, self._gradient, self._modes, optimize=True)
        field = ModelField(self._network, moments[:, None], self._inputs, None)
        return InternalWeight(field, gravity)


class MappedField:
    """u = F r at n nodes. gradient: of the basis there (n, n_rows, dim) [1/m].

    jacobian: "full", eq. 4.3; "without_gradient_change", eq. 4.4, without that of F; "linear", J = U, without any term.
    Only the full one is the derivative of the positions, with which forces are the gradient of the energy.
    """

    def __init__(self, local: LocalField, gradient: Array, jacobian: Jacobian = "full") -> None:
        self.local, self.mode = local, _known(jacobian)
        # By node, axis and row: F is then one product of matrices.
        self.by_row = np.ascontiguousarray(gradient.transpose(0, 2, 1))
        self.by_row_single = self.by_row.astype(np.float32)

    def of(self, local: LocalField) -> MappedField:
        """The same of another r, at the same nodes."""
        other = copy(self)
        other.local = local
        return other

    def at(self, index: IntArray) -> MappedField:
        """The same at some of the nodes (m,)."""
        other = self.of(self.local.some(index))
        other.by_row, other.by_row_single = self.by_row[index], self.by_row_single[index]
        return other

    def displacement(self, rows: Array) -> Array:
        """u (n, dim) [m] at handle rows (n_rows, dim)."""
        return times_each(self.deformation(rows), self.local.value(rows))

    def deformation(self, rows: Array) -> Array:
        """F^T (n, dim, dim) at handle rows (n_rows, dim)."""
        n, dim, n_rows = self.by_row.shape
        return np.asarray((self.by_row.reshape(-1, n_rows) @ rows).reshape(n, dim, dim))

    def linearise(self, rows: Array) -> MappedPoint:
        """u with the Jacobian that was asked for."""
        return MappedPoint(self, rows)


class MappedPoint(CorrectionField):
    """u = F r at one state. Its Jacobian and what is made with it are computed when they are needed: the gradient of an
    energy needs no Jacobian, only `pulled_back`."""

    def __init__(self, field: MappedField, rows: Array) -> None:
        self.__dict__["_field"], self.__dict__["_local"] = field, field.local.at(rows)
        self.__dict__["_F"] = field.deformation(rows)
        self.__dict__["displacement"] = times_each(self._F, self._local.value)
        self.__dict__["index"] = np.arange(len(self.displacement))

    _field: MappedField
    _local: LocalPoint
    _F: Array  # transposed, as `MappedField.deformation`

    @lazy
    def jacobian(self) -> Array:
        """See `CorrectionField`."""
        n, dim, n_rows = self._field.by_row.shape
        return self.along(None).astype(np.float64).reshape(n, dim, n_rows, dim)

    @lazy
    def _by_gradient(self) -> Array:
        """G r (n, n_rows): du_i = (G r) . drows_i, the part of the change of F."""
        return times_each(self._field.by_row, self._local.value)

    def along(self, directions: Array | None) -> NDArray[np.floating[Any]]:
        """See `CorrectionField`."""
        n, dim, n_rows = self._field.by_row.shape
        T = np.eye(n_rows * dim) if directions is None else directions
        if self._field.mode == "linear":
            return np.zeros((n * dim, T.shape[1]))
        of_r, F = self._local.along(directions), self._F.astype(np.float32)
        if self._field.mode == "full":
            through = self._by_gradient.astype(np.float32) @ T.reshape(n_rows, -1).astype(np.float32)
        else:
            through = np.zeros((n, dim * T.shape[1]), dtype=np.float32)
        return _mapped_jacobian(F, of_r, through.reshape(n, dim, -1)).reshape(n * dim, -1)

    def pulled_back(self, forces: Array) -> Array:
        """See `CorrectionField`."""
        _, dim, n_rows = self._field.by_row.shape
        if self._field.mode == "linear":
            return np.zeros((n_rows, dim))
        found = self._local.pulled_back(self._unturned(forces)).reshape(n_rows, dim)
        if self._field.mode != "full":
            return found
        # f . dF r = sum_nj (r_j f)_n . drows G_nj.
        both = (self._local.value[:, :, None] * forces[:, None, :]).reshape(-1, dim)
        return found + self._field.by_row.reshape(-1, n_rows).T @ both

    def curvature(self, forces: Array, directions: Array | None) -> Array | None:
        """See `CorrectionField`; of the full Jacobian alone."""
        if self._field.mode != "full":
            return None
        n, dim, n_rows = self._field.by_row.shape
        T = np.eye(n_rows * dim) if directions is None else directions
        total = self._local.curvature(self._unturned(forces), directions)
        # F along one change, and r along the other: f . (dF dr).
        turned = _turned(forces.astype(np.float32), self._field.by_row_single).reshape(n * dim, -1)
        cross = turned.T @ self._local.along(directions).reshape(n * dim, -1)
        both = T.astype(np.float32).T @ cross
        return np.asarray(total + both + both.T)

    def _unturned(self, forces: Array) -> Array:
        """F^T f (n, dim)."""
        return times_each(np.ascontiguousarray(self._F.transpose(0, 2, 1)), forces)


@summing(reference=lambda M, v: np.einsum("nij,ni->nj", M, v))
def times_each(M: Array, v: Array) -> Array:
    """M^T v (n, k) of matrices (n, dim, k) and vectors (n, dim)."""
    n, dim, count = M.shape
    total = np.zeros((n, count))
    for node in range(n):
        for i in range(dim):
            for k in range(count):
                total[node, k] += M[node, i, k] * v[node, i]
    return total


@summing(reference=lambda f, G: np.einsum("ni,njs->njsi", f, G).reshape(*G.shape[:2], -1))
def _turned(f: Singles, G: Singles) -> Singles:
    """f_i G_js (n, dim, n_rows*dim) over (node, j, (s, i)) of forces (n, dim) and gradients (n, dim, n_rows)."""
    n, dim, n_rows = G.shape
    every = np.empty((n, dim, n_rows * dim), G.dtype)
    for node in range(n):
        for j in range(dim):
            for s in range(n_rows):
                for i in range(dim):
                    every[node, j, s * dim + i] = f[node, i] * G[node, j, s]
    return every


@summing(reference=lambda F, of_r, through: np.einsum("nji,njk->nik", F, of_r) + through)
def _mapped_jacobian(F: Singles, of_r: Singles, through: Singles) -> Singles:
    """F of_r + through (n, dim, k); F: transposed (n, dim, dim)."""
    n, dim, count = of_r.shape
    J = through.copy()
    for node in range(n):
        for i in range(dim):
            for j in range(dim):
                share = F[node, j, i]
                for k in range(count):
                    J[node, i, k] += share * of_r[node, j, k]
    return J


def deformation(gradient: Array, rows: Array) -> Array:
    """F (n, dim, dim) at nodes with basis gradients (n, n_rows, dim)."""
    return np.asarray(rows.T @ gradient)


def mapped(gradient: Array, rows: Array, r: Array) -> Array:
    """F r (n, dim) [m]."""
    return np.asarray((deformation(gradient, rows) @ r[:, :, None])[:, :, 0])


def unmapped(gradient: Array, rows: Array, displacement: Array) -> Array:
    """F^-1 u (n, dim) [m], the target of eq. 4.8. Raises SoftprintError where the subspace inverts the body at a
    node."""
    F = deformation(gradient, rows)
    if np.linalg.det(F).min(initial=np.inf) <= 0.0:
        raise SoftprintError("the subspace inverts the body at a node: there is no correction that maps back")
    return np.asarray(np.linalg.solve(F, displacement[:, :, None])[:, :, 0])


def _known(jacobian: Jacobian) -> Jacobian:
    if jacobian not in JACOBIANS:
        raise SoftprintError(f"jacobian {jacobian!r} is not known; there are {', '.join(JACOBIANS)}")
    return jacobian
