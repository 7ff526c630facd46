"""The energy of contact with the detail condensed out: what dynamics minimises in place of penalty on rigid detail.

The contact displacement of a state is an equilibrium, so the energy of dent and contact is a function of the reduced
state alone: W(q) of `equilibrium.py`. No cubature of the body's volume has to resolve a dent, and no network runs
in the loop.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from runtime.arrays import Array, BoolArray, IntArray, RowHessian
from runtime.colliders.pose import RigidPose
from runtime.contact.condensed.collider_sensitivity import ColliderSensitivity
from runtime.contact.condensed.equilibrium import ContactEquilibrium, LoadProbe
from runtime.learned.correction import ContactForces
from runtime.rigid.twist import twist_size


class ContactPotential:
    """W of one body and one collider, as a function of handle rows, pose and the body's turn."""

    def __init__(self, probe: LoadProbe) -> None:
        self.probe = probe

    @property
    def nodes(self) -> IntArray:
        """(n_loads,) the nodes of the mesh where loads are."""
        return self.probe.nodes

    def begin(self) -> None:
        """See `Potential`."""
        self.probe.begin()

    def energy(self, rows: Array, pose: RigidPose, turn: Array) -> float:
        """W [J]."""
        press = self.probe.press(rows, pose, turn)
        return 0.0 if press is None else press.solution.energy

    def linearise(self, rows: Array, pose: RigidPose, turn: Array) -> tuple[float, Array, RowHessian | None]:
        """W [J], dW/drows (n_rows, dim) [N] and its Hessian (n_rows*dim, n_rows*dim) [N/m]; no Hessian where
        nothing is pressed. What is asked for next starts from this state."""
        press = self.probe.press(rows, pose, turn)
        self.probe.hold(press)
        if press is None or not press.bearing.size:
            return 0.0, np.zeros_like(rows), None
        return press.solution.energy, press.gradient, press.second_derivative

    def felt(
        self, rows: Array, pose: RigidPose, turn: Array, centre: Array
    ) -> tuple[Array, Callable[[], tuple[Array, Array]]]:
        """dW/dtwist and the blocks of the Hessian, see `Potential.felt`."""
        press = self.probe.press(rows, pose, turn)
        if press is None or not press.bearing.size:
            size = twist_size(len(centre))
            return np.zeros(size), lambda: (np.zeros((rows.size, size)), np.zeros((size, size)))
        twisted = ColliderSensitivity(press, centre)
        return twisted.gradient, twisted.blocks

    def pressed(self, rows: Array, pose: RigidPose, turn: Array) -> ContactForces:
        """The loads that push on the collider."""
        press = self.probe.press(rows, pose, turn)
        if press is None:
            return ContactForces.none(*rows.shape)
        return pressed_loads(press)

    def settled(self, rows: Array, pose: RigidPose, turn: Array) -> Callable[[IntArray], Array]:
        """See `LoadProbe.settled`."""
        return self.probe.settled(rows, pose, turn)


def pressed_loads(press: ContactEquilibrium, borne: BoolArray | None = None) -> ContactForces:
    """Those of a press that bear pressure; borne: (k,) which of them to tell of."""
    b, solution = press.bearing, press.solution
    loads = ContactForces(
        press.pressed,
        press.displaced,
        lambda: press.carried.reshape(*press.displaced.shape, -1),
        solution.normal[b],
        solution.pressure[b],
        solution.left[b],
    )
    return loads if borne is None else loads.take(borne)
