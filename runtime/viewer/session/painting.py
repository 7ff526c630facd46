"""What is drawn of a state: the positions of the drawn nodes, and one value at each of them to colour it by.

A painter may run in a process of its own (`painting_process.py`): it receives plain data and keeps nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.contact_force import ContactForce, SurfaceForces
from softprint.runtime.dynamics.simulator import Simulator
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.touch import surface_places
from softprint.runtime.touch.sensor import SurfaceSpread, TouchSensor

if TYPE_CHECKING:
    from softprint.runtime.learned.force.correction import BoundForceCorrection

Floats = NDArray[np.float32]

#: What a body can be coloured by, with its unit.
QUANTITIES = {
    "displacement": "mm",
    "contact pressure": "kPa",
    "strain": "",
    "confidence": "",
    "nothing": "",
}


def drawn_nodes(mesh: Mesh) -> IntArray:
    """The nodes that are drawn: of the surface in 3D, all in 2D."""
    return np.arange(mesh.n_nodes) if mesh.dim == 2 else mesh.surface_nodes


def drawn_faces(mesh: Mesh) -> IntArray:
    """(f, 3) triangles of drawn nodes: the surface in 3D, the cells in 2D."""
    faces = mesh.cells if mesh.dim == 2 else mesh.facets
    return np.asarray(np.searchsorted(drawn_nodes(mesh), faces))


def in_space(points: Array) -> Floats:
    """(n, 3) float32: points in the plane get z = 0."""
    flat = np.asarray(points, dtype=np.float32)
    return flat if flat.shape[1] == 3 else np.pad(flat, ((0, 0), (0, 1)))


@dataclass(frozen=True, eq=False)
class Order:
    """A picture that is asked for. meta: is handed on with it."""

    state: ReducedState
    contacts: dict[str, ContactForce]
    quantity: str
    meta: Any = None


def order_of(result: StepResult[ReducedState], quantity: str, meta: Any = None) -> Order:
    """The picture at the end of a step, without what only the next step needs."""
    state = replace(result.state, factorisation=None, elastic_hessian=None)
    return Order(state, dict(result.contacts), quantity, meta)


class Painter:
    """Paints one body as one model deforms it."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator
        self._nodes = drawn_nodes(simulator.body.mesh)
        self._positions = simulator.follow(self._nodes)
        self._known: dict[bytes, IntArray] = {}

    def paint(self, order: Order) -> tuple[Floats, Floats]:
        """Positions (n, 3) [m] of the drawn nodes, and values (n,) in the unit of `QUANTITIES`; NaN where there is
        none."""
        x = self._positions(order.state)
        return in_space(x), self._values(order, x).astype(np.float32)

    def _values(self, order: Order, x: Array) -> Array:
        if order.quantity == "displacement":
            return 1e3 * np.linalg.norm(x - self._rest, axis=1)
        if order.quantity == "contact pressure":
            return 1e-3 * self._pressure(order)
        if order.quantity == "strain":
            return self._strain(order)
        if order.quantity == "confidence":
            return self._confidence(order)
        return np.full(len(x), np.nan)

    def _pressure(self, order: Order) -> Array:
        """(n,) [Pa]"""
        parts = [self._same_nodes(part) for contact in order.contacts.values() for part in contact.parts]
        return self._spread.pressure(parts)

    def _same_nodes(self, part: SurfaceForces) -> SurfaceForces:
        """With the one array of nodes of its kind, as the spread remembers arrays and not their values."""
        return replace(part, nodes=self._known.setdefault(part.nodes.tobytes(), part.nodes))

    def _strain(self, order: Order) -> Array:
        felt = StepResult(order.state, 0, "", 0, 0.0, {}, {}, {})  # type: ignore[arg-type]
        return self._sensor.feel(felt).strain_norm

    def _confidence(self, order: Order) -> Array:
        """That of the correction of each collider where the collider touches."""
        values = np.full(len(self._nodes), np.nan)
        for name, factor in self.confidences(order.state).items():
            parts = [self._same_nodes(part) for part in order.contacts[name].parts]
            values[self._spread.pressure(parts) > 0] = factor
        return values

    def confidences(self, state: ReducedState) -> dict[str, float]:
        """By collider in contact, the factor in [0, 1] that reduces the correction of its contact outside the range of
        training; empty for models without one."""
        if state.contact is None or not state.contact_is_here:
            return {}
        found = {name: bound.confidence(state.contact) for name, bound in self._with_confidence.items()}
        return {name: factor for name, factor in found.items() if factor is not None}

    @cached_property
    def _with_confidence(self) -> dict[str, BoundForceCorrection]:
        corrections = self._simulator.corrections
        contact = corrections.contact
        if contact is None:
            return {}
        # Imported here, because torch takes a second to load and the bare model does not need it.
        from softprint.runtime.learned.force.correction import ForceCorrection

        nowhere = self._body.node_points(np.empty(0, dtype=np.int64))
        return {
            name: correction.bind(nowhere, contact, name)
            for name, correction in corrections.of_contact.items()
            if isinstance(correction, ForceCorrection)
        }

    @cached_property
    def _rest(self) -> Array:
        return self._body.mesh.points[self._nodes]

    @property
    def _body(self) -> ReducedBody:
        return self._simulator.body

    @cached_property
    def _spread(self) -> SurfaceSpread:
        return SurfaceSpread(self._body, surface_places(self._body, self._nodes))

    @cached_property
    def _sensor(self) -> TouchSensor:
        return TouchSensor(self._simulator, self._body, surface_places(self._body, self._nodes))
