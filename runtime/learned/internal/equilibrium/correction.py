"""An internal correction of modes in elastic equilibrium: u(q) = F(q) sum_k a_k(q) m_k, with a of least elastic energy.

Nothing but the modes is learned; how far each is displaced follows from the elasticity of the body
(`elastic_amplitudes.py`). E_a = 0 at every state, so that the elastic energy of the corrected body is E(q, a(q)) with

    dE/dq = E_q,    d2E/dq2 = E_qq - E_qa E_aa^-1 E_aq,

on the cubature of the body. Forces of contact are pulled back by one solve. Second derivatives of a count in the
Hessian of contact: without them, which is the approximation of thesis 5.4, Newton's method converges linearly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.elasticity.displacement_field import CorrectionField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.lazy import lazy
from softprint.runtime.learned.correction import require_body
from softprint.runtime.learned.internal.equilibrium.elastic_amplitudes import (
    AmplitudePoint,
    ElasticAmplitudes,
)
from softprint.runtime.learned.internal.equilibrium.mode_field import ModeField, RowModes
from softprint.runtime.learned.internal.inputs import RigidFreeRows
from softprint.runtime.learned.internal.model import ModesModel
from softprint.runtime.learned.internal.weight import InternalWeight


class EquilibriumCorrection:
    """The modes of a model in equilibrium in a body, which has the cubature to integrate with. gravity: (dim,) [m/s^2]
    of the simulation, by default that of the training. Raises SoftprintError for a body with other nodes or handles."""

    on_condensation = False

    def __init__(
        self, model: ModesModel, body: ReducedBody, gravity: Sequence[float] | Array | None = None
    ) -> None:
        require_body("internal", model.dim, model.n_rows, body)
        modes = model.modes.double().numpy()
        if modes.shape[1] != body.n_nodes:
            raise SoftprintError(
                f"an internal correction of {modes.shape[1]} nodes is used with body {body.name!r} of "
                f"{body.n_nodes}: train it for this body"
            )
        pull = np.zeros(body.dim) if gravity is None else np.asarray(gravity, dtype=float)
        if gravity is None and model.options.gravity:
            pull = np.asarray(model.options.gravity)
        self.gravity: tuple[float, ...] = tuple(map(float, pull)) if pull.any() else ()
        self._field = ModeField.of(body, modes)
        inputs = RigidFreeRows.of(body, model.options.gravity)
        linear, offset = model.estimate()
        self.amplitudes = ElasticAmplitudes(
            body, self._field, lambda rows: linear @ inputs(rows) + offset, pull
        )

    @property
    def gradient(self) -> Array:
        """G of the basis at all nodes (n_nodes, n_rows, dim) [1/m]."""
        return self._field.by_row.transpose(0, 2, 1)

    def bind(self, nodes: IntArray | None = None) -> BoundModes:
        """See `InternalField`."""
        return BoundModes(self.amplitudes, self._field if nodes is None else self._field.some(nodes))

    def weight(self, mass: Array, gravity: Array) -> InternalWeight:
        """See `InternalField`."""
        return InternalWeight(AmplitudeMoments(self.amplitudes, self._field.moments(mass)), gravity)


@dataclass(frozen=True, eq=False)
class BoundModes:
    """A `BoundInternal`: u at the nodes of a mode field."""

    amplitudes: ElasticAmplitudes
    field: ModeField

    def displacement(self, rows: Array) -> Array:
        """See `BoundInternal`."""
        return self.field.at(rows).displacement(self.amplitudes.at(rows).a)

    def linearise(self, rows: Array) -> ModesPoint:
        """See `BoundInternal`."""
        return ModesPoint(self.field, self.amplitudes.at(rows))

    def at(self, index: IntArray) -> BoundModes:
        """See `BoundInternal`."""
        return BoundModes(self.amplitudes, self.field.some(index))


class ModesPoint(CorrectionField):
    """u of modes at one state."""

    def __init__(self, field: ModeField, point: AmplitudePoint) -> None:
        self.__dict__ |= {"_field": field, "_point": point, "index": np.arange(len(field.modes))}
        self.__dict__["_modes"] = modes = field.at(point.rows)
        self.__dict__["displacement"] = modes.displacement(point.a)

    _field: ModeField
    _modes: RowModes
    _point: AmplitudePoint

    @property
    def converged(self) -> bool:
        """See `CorrectionField`."""
        return self._point.converged

    @lazy
    def jacobian(self) -> Array:
        """See `CorrectionField`."""
        shape = *self.displacement.shape, *self._point.rows.shape
        return self.along(None).astype(np.float64).reshape(shape)

    def along(self, directions: Array | None) -> NDArray[np.floating[Any]]:
        """See `CorrectionField`; in single precision."""
        T = np.eye(self._point.rows.size) if directions is None else directions
        da = self._point.along(directions).astype(np.float32)
        return np.asarray(self._field.row_along(self._point.a, T) + self._modes.by_amplitude @ da)

    def pulled_back(self, forces: Array) -> Array:
        """See `CorrectionField`."""
        along = self._modes.forces(forces)
        return self._field.row_forces(self._point.a, forces) + self._point.pulled_back(along)

    def curvature(self, forces: Array, directions: Array | None) -> Array:
        """See `CorrectionField`."""
        mixed = self._field.mixed(forces)
        along = mixed if directions is None else directions.T.astype(np.float32) @ mixed
        both = along.astype(np.float64) @ self._point.along(directions)
        return both + both.T + self._point.curvature(self._modes.forces(forces), directions)


@dataclass(frozen=True, eq=False)
class AmplitudeMoments:
    """moments a (1, n_rows) as a `LocalField`; moments: (n_rows, K)."""

    amplitudes: ElasticAmplitudes
    moments: Array

    def value(self, rows: Array) -> Array:
        """See `LocalField`."""
        return (self.moments @ self.amplitudes.at(rows).a)[None]

    def at(self, rows: Array) -> MomentPoint:
        """See `LocalField`."""
        return MomentPoint(self.moments, self.amplitudes.at(rows))

    def some(self, index: IntArray) -> AmplitudeMoments:
        """See `LocalField`: there is one place."""
        return self


@dataclass(frozen=True, eq=False)
class MomentPoint:
    """A `LocalPoint` of `AmplitudeMoments`."""

    moments: Array
    point: AmplitudePoint

    @property
    def value(self) -> Array:
        """See `LocalPoint`."""
        return (self.moments @ self.point.a)[None]

    def along(self, directions: Array | None) -> Array:
        """See `LocalPoint`."""
        return (self.moments @ self.point.along(directions))[None]

    def pulled_back(self, forces: Array) -> Array:
        """See `LocalPoint`."""
        return self.point.pulled_back(self.moments.T @ forces[0]).ravel()

    def curvature(self, forces: Array, directions: Array | None) -> Array:
        """See `LocalPoint`."""
        return self.point.curvature(self.moments.T @ forces[0], directions)
