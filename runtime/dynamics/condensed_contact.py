"""Contact and friction with colliders whose correction brings its own energy (`contact_potential.py`).

There the detail is condensed out: the energy is a function of the handle rows, and neither corrected points nor the
cubature of the body's volume take part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from runtime.arrays import Array, Hessian, IntArray
from runtime.contact import CoulombFriction
from runtime.corrections.correction import Potential
from runtime.dynamics.condensed_friction import CondensedFriction
from runtime.dynamics.corrected_points import Poses
from runtime.dynamics.coupling import Centres, Coupling
from runtime.dynamics.state import ContactForce, SurfaceLoads, resultant
from runtime.dynamics.step_contact import StepContact


class CondensedContact:
    """The potentials of a scene, by name of the collider. turn: see `Potential`; step: what friction remembers, None
    outside of steps."""

    def __init__(self, potentials: Mapping[str, Potential], friction: CoulombFriction | None = None) -> None:
        self._potentials = potentials
        self._friction = None if friction is None else CondensedFriction(friction)

    def settled(self, rows: Array, poses: Poses, turn: Array) -> dict[str, Callable[[IntArray], Array]]:
        """Where loads are in a state, see `Potential`."""
        return {
            name: potential.settled(rows, poses[name], turn) for name, potential in self._potentials.items()
        }

    def energy(self, rows: Array, poses: Poses, turn: Array, step: StepContact | None) -> float:
        """Of contact and (lagged) friction [J]; none of friction before it was lagged."""
        total = 0.0
        for name, potential in self._potentials.items():
            total += potential.energy(rows, poses[name], turn)
            if self._friction is not None and step is not None and name in step.sliding:
                total += self._friction.terms(name, rows, poses, step).energy
        return total

    def linearise(
        self, rows: Array, poses: Poses, turn: Array, step: StepContact | None, relag: bool
    ) -> tuple[float, Array, list[Hessian]]:
        """Energy [J], gradient (n_rows, dim) [N] and Hessians [N/m], to be summed, by the rows.
        ``relag``: let friction take up the loads found here."""
        energy, gradient = 0.0, np.zeros_like(rows)
        hessians: list[Hessian] = []
        for name, potential in self._potentials.items():
            parts = [potential.linearise(rows, poses[name], turn)]
            if self._friction is not None and step is not None:
                if relag:
                    self._friction.lag(name, potential, rows, poses, turn, step)
                parts.append(self._friction.linearise(name, rows, poses, step))
            for more, slope, hessian in parts:
                energy, gradient = energy + more, gradient + slope
                if hessian is not None:
                    hessians.append(hessian)
        return energy, gradient, hessians

    def couplings(
        self, rows: Array, poses: Poses, turn: Array, centres: Centres, step: StepContact | None
    ) -> list[Coupling]:
        """What colliders that move freely feel of it, at the loads that `linearise` found."""
        felt: list[Coupling | None] = []
        for name, centre in centres.items():
            potential = self._potentials.get(name)
            if potential is None:
                continue
            slope, blocks = potential.felt(rows, poses[name], turn, centre)
            felt.append(Coupling(name, slope, blocks))
            if self._friction is not None and step is not None:
                felt.append(self._friction.coupling(name, rows, poses, centre, step))
        return [coupling for coupling in felt if coupling is not None]

    def forces(
        self, rows: Array, poses: Poses, turn: Array, step: StepContact | None
    ) -> tuple[float, float, dict[str, ContactForce]]:
        """Contact energy, friction energy [J] and the force on each collider."""
        normal_energy, friction_energy = 0.0, 0.0
        forces = {}
        for name, potential in self._potentials.items():
            normal_energy += potential.energy(rows, poses[name], turn)
            pressed = potential.pressed(rows, poses[name], turn)
            # A load pushes the collider against the gradient of its signed distance.
            push = -pressed.pressure[:, None] * pressed.normal
            loads = [SurfaceLoads(potential.nodes, pressed.index, pressed.position, push)]
            if self._friction is not None and step is not None:
                friction = self._friction.terms(name, rows, poses, step)
                friction_energy += friction.energy
                sliding = step.sliding[name]
                slid = sliding.index, sliding.positions(rows), friction.gradient
                loads.append(SurfaceLoads(potential.nodes, *slid, tangential=True))
            force, torque = resultant(loads, poses[name].translation)
            forces[name] = ContactForce(
                force, torque, float(pressed.left.max(initial=0.0)), len(pressed.index), loads
            )
        return normal_energy, friction_energy, forces
