"""The contact energies of a scene, together where they share a compliance and alone where not.

Colliders whose potentials press the loads of one compliance are pressed jointly (`joint_press.py`), so that each feels
what the others do to the body. A collider on its own is left to its own potential.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from runtime.arrays import Array, IntArray, RowHessian
from runtime.colliders.pose import Poses
from runtime.contact.condensed.collider_sensitivity import ColliderSensitivity
from runtime.contact.condensed.contact_potential import ContactPotential, pressed_loads
from runtime.contact.condensed.joint_press import JointProbe
from runtime.learned.correction import ContactForces, Potential

Blocks = Callable[[], tuple[Array, Array]]


class Felt(NamedTuple):
    """What free colliders feel: by name dW/dtwist and the blocks of `Potential.felt`; by two names, what one feels of
    the other through the body, d2W/dtwist dtwist' (n_twist, n_twist)."""

    alone: Mapping[str, tuple[Array, Blocks]]
    links: Mapping[tuple[str, str], Callable[[], Array]]


class PotentialGroup(Protocol):
    """A `Potential` of several colliders; poses of all colliders of the scene, by name."""

    def begin(self) -> None: ...

    def energy(self, rows: Array, poses: Poses, turn: Array) -> float: ...

    def linearise(self, rows: Array, poses: Poses, turn: Array) -> tuple[float, Array, RowHessian | None]: ...

    def felt(self, rows: Array, poses: Poses, turn: Array, centres: Mapping[str, Array]) -> Felt:
        """centres (dim,) of mass of the colliders that move freely, by name."""
        ...

    def pressed(self, rows: Array, poses: Poses, turn: Array) -> dict[str, ContactForces]:
        """By collider."""
        ...

    def settled(self, rows: Array, poses: Poses, turn: Array) -> dict[str, Callable[[IntArray], Array]]:
        """By collider."""
        ...


def grouped(potentials: Mapping[str, Potential]) -> list[PotentialGroup]:
    """Potentials of one compliance together."""
    shared: dict[int, dict[str, ContactPotential]] = {}
    groups: list[PotentialGroup] = []
    for name, potential in potentials.items():
        if isinstance(potential, ContactPotential):
            shared.setdefault(id(potential.probe.among_loads), {})[name] = potential
        else:
            groups.append(SinglePotential(name, potential))
    for together in shared.values():
        if len(together) == 1:
            groups += [SinglePotential(name, potential) for name, potential in together.items()]
        else:
            groups.append(JointPotential(together))
    return groups


class SinglePotential:
    """Of one collider; a `PotentialGroup`."""

    def __init__(self, name: str, potential: Potential) -> None:
        self._name, self._potential = name, potential

    def begin(self) -> None:
        """See `Potential.begin`."""
        self._potential.begin()

    def energy(self, rows: Array, poses: Poses, turn: Array) -> float:
        """W [J]."""
        return self._potential.energy(rows, poses[self._name], turn)

    def linearise(self, rows: Array, poses: Poses, turn: Array) -> tuple[float, Array, RowHessian | None]:
        """See `Potential.linearise`."""
        return self._potential.linearise(rows, poses[self._name], turn)

    def felt(self, rows: Array, poses: Poses, turn: Array, centres: Mapping[str, Array]) -> Felt:
        """See `PotentialGroup.felt`."""
        name = self._name
        if name not in centres:
            return Felt({}, {})
        return Felt({name: self._potential.felt(rows, poses[name], turn, centres[name])}, {})

    def pressed(self, rows: Array, poses: Poses, turn: Array) -> dict[str, ContactForces]:
        """See `PotentialGroup.pressed`."""
        return {self._name: self._potential.pressed(rows, poses[self._name], turn)}

    def settled(self, rows: Array, poses: Poses, turn: Array) -> dict[str, Callable[[IntArray], Array]]:
        """See `PotentialGroup.settled`."""
        return {self._name: self._potential.settled(rows, poses[self._name], turn)}


class JointPotential:
    """Of several colliders on one compliance; a `PotentialGroup`."""

    def __init__(self, potentials: Mapping[str, ContactPotential]) -> None:
        self._names = tuple(potentials)
        self.probe = JointProbe({name: potential.probe for name, potential in potentials.items()})

    def begin(self) -> None:
        """See `Potential.begin`."""
        self.probe.begin()

    def energy(self, rows: Array, poses: Poses, turn: Array) -> float:
        """W [J] of all of them."""
        joint = self.probe.press(rows, poses, turn)
        return 0.0 if joint is None else joint.press.solution.energy

    def linearise(self, rows: Array, poses: Poses, turn: Array) -> tuple[float, Array, RowHessian | None]:
        """See `Potential.linearise`."""
        joint = self.probe.press(rows, poses, turn)
        self.probe.hold(joint)
        if joint is None or not joint.press.bearing.size:
            return 0.0, np.zeros_like(rows), None
        press = joint.press
        return press.solution.energy, press.gradient, press.second_derivative

    def felt(self, rows: Array, poses: Poses, turn: Array, centres: Mapping[str, Array]) -> Felt:
        """See `PotentialGroup.felt`."""
        joint = self.probe.press(rows, poses, turn)
        if joint is None:
            return Felt({}, {})
        twisted: dict[str, ColliderSensitivity] = {}
        for name in joint.names:
            borne = joint.borne_by(name)
            if name in centres and borne.any():
                twisted[name] = ColliderSensitivity(joint.press, centres[name], borne)
        pairs = ((one, other) for one in twisted for other in twisted if one < other)
        links = {pair: partial(twisted[pair[0]].link, twisted[pair[1]]) for pair in pairs}
        return Felt({name: (one.gradient, one.blocks) for name, one in twisted.items()}, links)

    def pressed(self, rows: Array, poses: Poses, turn: Array) -> dict[str, ContactForces]:
        """See `PotentialGroup.pressed`."""
        joint = self.probe.press(rows, poses, turn)
        if joint is None:
            return {name: ContactForces.none(*rows.shape) for name in self._names}
        return {name: pressed_loads(joint.press, joint.borne_by(name)) for name in self._names}

    def settled(self, rows: Array, poses: Poses, turn: Array) -> dict[str, Callable[[IntArray], Array]]:
        """See `PotentialGroup.settled`."""
        return dict.fromkeys(self._names, self.probe.settled(rows, poses, turn))
