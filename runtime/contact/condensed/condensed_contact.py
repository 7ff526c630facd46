"""Contact and friction with colliders whose correction brings its own energy (`contact_potential.py`).

There the detail is condensed out: the energy is a function of the handle rows, and neither corrected points nor the
cubature of the body's volume take part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from runtime.arrays import Array, IntArray, RowHessian
from runtime.colliders.pose import Poses
from runtime.contact import CoulombFriction
from runtime.contact.collider_coupling import Centres, Coupling, Link
from runtime.contact.condensed.condensed_friction import CondensedFriction
from runtime.contact.condensed.joint_press import JointProbe
from runtime.contact.condensed.potential_group import JointPotential, grouped
from runtime.contact.contact_force import ContactForce, SurfaceForces, resultant
from runtime.contact.friction_state import FrictionState
from runtime.learned.correction import Potential


class CondensedContact:
    """The potentials of a scene, by name of the collider. turn: see `Potential`; step: what friction remembers, None
    outside of steps."""

    def __init__(self, potentials: Mapping[str, Potential], friction: CoulombFriction | None = None) -> None:
        self._potentials, self._groups = potentials, grouped(potentials)
        self._friction = None if friction is None else CondensedFriction(friction)

    @property
    def joint(self) -> dict[str, JointProbe]:
        """Of the colliders that press together with others, by name, what presses them."""
        joint = [group for group in self._groups if isinstance(group, JointPotential)]
        return {name: group.probe for group in joint for name in group.probe.probes}

    def begin(self) -> None:
        """A motion begins: forget where contact came from."""
        for group in self._groups:
            group.begin()

    def settled(self, rows: Array, poses: Poses, turn: Array) -> dict[str, Callable[[IntArray], Array]]:
        """Where loads are in a state, see `Potential`."""
        return {k: at for group in self._groups for k, at in group.settled(rows, poses, turn).items()}

    def energy(self, rows: Array, poses: Poses, turn: Array, step: FrictionState | None) -> float:
        """Of contact and (lagged) friction [J]; none of friction before it was lagged."""
        total = sum(group.energy(rows, poses, turn) for group in self._groups)
        if self._friction is not None and step is not None:
            for name in step.sliding:
                total += self._friction.terms(name, rows, poses, step).energy
        return total

    def linearise(
        self, rows: Array, poses: Poses, turn: Array, step: FrictionState | None, relag: bool
    ) -> tuple[float, Array, list[RowHessian]]:
        """Energy [J], gradient (n_rows, dim) [N] and Hessians [N/m], to be summed, by the rows.
        ``relag``: let friction take up the loads found here."""
        parts = [group.linearise(rows, poses, turn) for group in self._groups]
        if self._friction is not None and step is not None:
            if relag:
                for group in self._groups:
                    for name, loads in group.pressed(rows, poses, turn).items():
                        self._friction.lag(name, loads, rows, poses, step)
            parts += [self._friction.linearise(name, rows, poses, step) for name in self._potentials]
        energy, gradient = 0.0, np.zeros_like(rows)
        for more, slope, _ in parts:
            energy, gradient = energy + more, gradient + slope
        return energy, gradient, [hessian for *_, hessian in parts if hessian is not None]

    def couplings(
        self, rows: Array, poses: Poses, turn: Array, centres: Centres, step: FrictionState | None
    ) -> tuple[list[Coupling], list[Link]]:
        """What colliders that move freely feel of it, at the loads that `linearise` found, and of each other."""
        if not centres:
            return [], []
        felt = [group.felt(rows, poses, turn, centres) for group in self._groups]
        couplings = [Coupling(name, *parts) for of_group in felt for name, parts in of_group.alone.items()]
        links = [Link(*names, block) for of_group in felt for names, block in of_group.links.items()]
        if self._friction is not None and step is not None:
            rubbed = (
                self._friction.coupling(name, rows, poses, centres[name], step)
                for name in self._potentials
                if name in centres
            )
            couplings += [coupling for coupling in rubbed if coupling is not None]
        return couplings, links

    def forces(
        self, rows: Array, poses: Poses, turn: Array, step: FrictionState | None
    ) -> tuple[float, float, dict[str, ContactForce]]:
        """Contact energy, friction energy [J] and the force on each collider."""
        normal_energy = sum(group.energy(rows, poses, turn) for group in self._groups)
        found = [group.pressed(rows, poses, turn) for group in self._groups]
        friction_energy = 0.0
        forces = {}
        for name, pressed in ((name, pressed) for of_group in found for name, pressed in of_group.items()):
            nodes = self._potentials[name].nodes
            # A load pushes the collider against the gradient of its signed distance.
            push = -pressed.pressure[:, None] * pressed.normal
            loads = [SurfaceForces(nodes, pressed.index, pressed.position, push)]
            if self._friction is not None and step is not None:
                friction = self._friction.terms(name, rows, poses, step)
                friction_energy += friction.energy
                sliding = step.sliding[name]
                slid = sliding.index, sliding.positions(rows), friction.gradient
                loads.append(SurfaceForces(nodes, *slid, tangential=True))
            force, torque = resultant(loads, poses[name].translation)
            forces[name] = ContactForce(
                force, torque, float(pressed.left.max(initial=0.0)), len(pressed.index), loads
            )
        return normal_energy, friction_energy, forces
