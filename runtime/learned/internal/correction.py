"""The internal correction of a body: u = F(q) r(q), added to U q or to static condensation (thesis eq. 4.1).

r is a displacement in the undeformed body. The deformation gradient F of the subspace at the nodes, by moving least
squares (`runtime/body/node_gradients.py`), maps it to the world:

    x = U q + F(q) r(q),    dx/dq = U + mat(r) dF/dq + F dr/dq          (4.3).

It depends on the reduced state alone, so one correction belongs to the body, and every collider sees the corrected
body. Elastic energy and contact are taken at the corrected positions, and forces on the handles are J^T f.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, Protocol, get_args

import numpy as np
import torch

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.correction import CorrectionField, require_body
from softprint.runtime.learned.internal.inputs import RigidFreeRows
from softprint.runtime.learned.internal.model import InternalModel

Jacobian = Literal["full", "without_gradient_change", "linear"]
JACOBIANS: tuple[Jacobian, ...] = get_args(Jacobian)


class LocalCorrection(NamedTuple):
    """r (n, dim) [m] of nodes in the undeformed body, and dr/drows (n, dim, n_rows, dim) or None."""

    value: Array
    derivative: Array | None


class LocalField(Protocol):
    """r as a function of the handle rows, at fixed nodes."""

    def __call__(self, rows: Array, derivative: bool) -> LocalCorrection:
        """r at handle rows (n_rows, dim), with its derivative if that is asked for."""
        ...


class InternalCorrection:
    """The trained correction of a body. on_condensation: whether it adds to static condensation; jacobian: of figure
    4.4, see `MappedField`. Raises SoftprintError for a body with other nodes or handles."""

    def __init__(self, model: InternalModel, body: ReducedBody, jacobian: Jacobian = "full") -> None:
        require_body("internal", model.dim, model.n_rows, body)
        if model.modes.shape[1] != body.n_nodes:
            raise SoftprintError(
                f"an internal correction of {model.modes.shape[1]} nodes is used with body {body.name!r} of "
                f"{body.n_nodes}: train it for this body"
            )
        self.on_condensation = model.options.on_condensation
        self.jacobian = _known(jacobian)
        self._model, self._inputs = model.double().eval(), RigidFreeRows.of(body)
        self._gradient = basis_gradient_at_nodes(body)

    def bind(self, nodes: IntArray | None = None) -> MappedField:
        """The correction at some nodes of the body, all by default."""
        gradient = self._gradient if nodes is None else self._gradient[nodes]
        return MappedField(_ModelField(self._model, self._inputs, nodes), gradient, self.jacobian)


class MappedField:
    """u = F r at n nodes. gradient: of the basis there (n, n_rows, dim) [1/m].

    jacobian: "full", eq. 4.3; "without_gradient_change", eq. 4.4, without that of F; "linear", J = U, without any term.
    Only the full one is the derivative of the positions, with which forces are the gradient of the energy.
    """

    def __init__(self, local: LocalField, gradient: Array, jacobian: Jacobian = "full") -> None:
        self._local, self._gradient, self._jacobian = local, gradient, _known(jacobian)

    def displacement(self, rows: Array) -> Array:
        """u (n, dim) [m] at handle rows (n_rows, dim)."""
        return mapped(self._gradient, rows, self._local(rows, False).value)

    def linearise(self, rows: Array) -> CorrectionField:
        """u with the Jacobian that was asked for."""
        r, derivative = self._local(rows, self._jacobian != "linear")
        u = mapped(self._gradient, rows, r)
        jacobian = np.zeros((*u.shape, *rows.shape))
        if derivative is not None:
            F = deformation(self._gradient, rows)
            jacobian += (F @ derivative.reshape(*u.shape, -1)).reshape(jacobian.shape)
        if self._jacobian == "full":
            along = (self._gradient @ r[:, :, None])[:, :, 0]
            for axis in range(rows.shape[1]):
                jacobian[:, axis, :, axis] += along
        return CorrectionField(np.arange(len(u)), u, jacobian)


class _ModelField:
    """r of a trained model at some nodes."""

    def __init__(self, model: InternalModel, inputs: RigidFreeRows, nodes: IntArray | None) -> None:
        modes = model.modes.numpy()
        self._model, self._inputs = model, inputs
        self._modes = modes if nodes is None else np.ascontiguousarray(modes[:, nodes])

    def __call__(self, rows: Array, derivative: bool) -> LocalCorrection:
        z = torch.from_numpy(self._inputs(rows))
        if not derivative:
            with torch.no_grad():
                c = self._model(z).numpy()
            return LocalCorrection(np.tensordot(c, self._modes, 1), None)
        of_z = self._model.linearise(z)
        c, slope = of_z[0].numpy(), of_z[1].numpy() @ self._inputs.derivative(rows)
        by_rows = self._modes.reshape(len(c), -1).T @ slope
        value = np.tensordot(c, self._modes, 1)
        return LocalCorrection(value, by_rows.reshape(*value.shape, *rows.shape))


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
