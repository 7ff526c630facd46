"""Contact with colliders whose correction brings its own energy (`runtime/corrections/contact_potential.py`).

There the detail is condensed out: the energy is a function of the handle rows, and neither corrected points nor the
cubature of the body's volume take part.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from runtime.arrays import Array
from runtime.corrections.correction import Potential, PressedLoads
from runtime.dynamics.corrected_points import Poses
from runtime.dynamics.state import ContactForce, resultant


class CondensedContact:
    """The potentials of a scene, by name of the collider."""

    def __init__(self, potentials: Mapping[str, Potential]) -> None:
        self._potentials = potentials

    def energy(self, rows: Array, poses: Poses, turn: Array) -> float:
        """[J]; turn: see `Potential`."""
        return sum(potential.energy(rows, poses[name], turn) for name, potential in self._potentials.items())

    def linearise(self, rows: Array, poses: Poses, turn: Array) -> tuple[float, Array, Array | None]:
        """Energy [J], gradient (n_rows, dim) [N] and Hessian [N/m] by the rows; no Hessian where nothing touches."""
        energy, gradient = 0.0, np.zeros_like(rows)
        hessian: Array | None = None
        for name, potential in self._potentials.items():
            more, slope, stiffness = potential.linearise(rows, poses[name], turn)
            energy, gradient = energy + more, gradient + slope
            if stiffness is not None:
                hessian = stiffness if hessian is None else hessian + stiffness
        return energy, gradient, hessian

    def forces(self, rows: Array, poses: Poses, turn: Array) -> dict[str, ContactForce]:
        """The force on each collider."""
        return {
            name: _force(potential.pressed(rows, poses[name], turn), poses[name].translation)
            for name, potential in self._potentials.items()
        }


def _force(loads: PressedLoads, origin: Array) -> ContactForce:
    """A load pushes the collider against the gradient of its signed distance."""
    push = -loads.pressure[:, None] * loads.normal
    force, torque = resultant([(loads.position, push)], origin)
    return ContactForce(force, torque, float(loads.left.max(initial=0.0)), len(loads.pressure))
