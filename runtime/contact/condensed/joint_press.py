"""Several colliders pressed into one body at once: one compliance, and every load meets the collider it is nearest to.

Dents are felt far: on the small Jelly two balls pressed in 3 contact radii apart push back 11 % more than each alone
says, because what one pushes aside the other has to push too, and 20 % less where their dents overlap. So the loads of
all colliders in contact are balanced together (`contact_solve.py`); nothing else changes. Where one collider alone
is in contact this is its own press.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Protocol, runtime_checkable

import numpy as np

from runtime.arrays import Array, BoolArray, IntArray
from runtime.colliders.collider import SdfDerivatives
from runtime.colliders.pose import Poses, RigidPose
from runtime.contact.condensed.candidates import ActiveSet, Candidates, ColliderDistance
from runtime.contact.condensed.contact_solve import ContactProblem
from runtime.contact.condensed.equilibrium import ContactEquilibrium, LoadProbe
from runtime.contact.condensed.press_memory import PressMemory
from runtime.contact.condensed.warm_start import warm_start
from runtime.errors import SoftprintError


@dataclass(frozen=True, eq=False)
class NearestDistance:
    """The signed distances that loads (m,) have of the colliders they meet; owner: (m,) which of them."""

    colliders: tuple[ColliderDistance, ...]
    owner: IntArray

    def value(self, x: Array) -> Array:
        """Without its derivatives (m,) [m]."""
        found = np.empty(len(x))
        for mine, distance in zip(self._owned, self.colliders, strict=True):
            found[mine] = distance.value(x[mine])
        return found

    def among(self, which: BoolArray) -> NearestDistance:
        """See `NodeDistance`."""
        return NearestDistance(self.colliders, self.owner[which])

    def __call__(self, x: Array) -> SdfDerivatives:
        if len(self.colliders) == 1:
            return self.colliders[0](x)
        m, dim = x.shape
        found = SdfDerivatives(np.empty(m), np.empty((m, dim)), np.empty((m, dim, dim)))
        for number, distance in enumerate(self.colliders):
            mine = self._owned[number]
            for column, own in zip(found, distance(x[mine]), strict=True):
                column[mine] = own
        return found

    @cached_property
    def _owned(self) -> list[IntArray]:
        """By collider, which loads meet it."""
        return [np.flatnonzero(self.owner == number) for number in range(len(self.colliders))]


@dataclass(frozen=True, eq=False)
class JointPress:
    """press: of all loads together; owner: (m,) which of the colliders `names`, at poses, each could press on."""

    press: ContactEquilibrium
    names: tuple[str, ...]
    poses: Poses
    owner: IntArray

    def borne_by(self, name: str) -> BoolArray:
        """Which of the k loads that bear pressure press on the collider."""
        if name not in self.names:
            return np.zeros(self.press.bearing.size, dtype=bool)
        return np.equal(self.owner[self.press.bearing], self.names.index(name))

    def held_by(self, name: str) -> ActiveSet:
        """The same, as loads of the body."""
        return self.press.held.take(self.borne_by(name))

    def predict(self, index: IntArray, problem: ContactProblem, poses: Poses) -> tuple[Array, Array] | None:
        """See `ContactEquilibrium.predict`."""
        y = self.press.gone_to
        follows, turns = np.empty_like(y), np.empty((*y.shape, y.shape[1]))
        for number, name in enumerate(self.names):
            mine, before, after = self.owner == number, self.poses[name], poses[name]
            follows[mine] = after.apply(before.apply_inverse(y[mine])) - y[mine]
            turns[mine] = after.rotation @ before.rotation.T
        return warm_start(self.press, index, problem, follows, turns)


@runtime_checkable
class BoundPressed(Protocol):
    """A correction at points whose loads may be pressed together with those of others."""

    def pressed(
        self, joint: JointPress | None, rows: Array, pose: RigidPose, turn: Array | None = None
    ) -> Any:
        """What `drawn` asks for, as plain data: the loads are pressed now. joint: with others; then this is the share
        of one collider, and their sum is what they do to the body."""
        ...

    def drawn(self, loads: Any) -> Array:
        """u (n, dim) [m], worked out on any thread or in another process, whatever is pressed in the meantime."""
        ...


class JointProbe:
    """Presses the loads of one body against several colliders: probes by name, all of one compliance."""

    def __init__(self, probes: Mapping[str, LoadProbe]) -> None:
        self.probes = dict(probes)
        self._any = next(iter(self.probes.values()))
        self._memory = PressMemory[Poses, JointPress](self._same)
        if any(probe.unlike(self._any) for probe in self.probes.values()):
            raise SoftprintError(
                f"the corrections of {', '.join(map(repr, probes))} press one body together, but with another contact "
                "stiffness, band or internal response each: give them the same"
            )

    def _same(self, last: Poses, poses: Poses) -> bool:
        return all(last[name] is poses[name] for name in self.probes)

    def press(self, rows: Array, poses: Poses, turn: Array) -> JointPress | None:
        """The loads in balance at handle rows (n_rows, dim), or None where none is inside a collider."""
        return self._memory.press(rows, dict(poses), turn, partial(self._press, rows, poses, turn))

    def begin(self) -> None:
        """Forget what was pressed before, and start from nothing."""
        self._memory.forget()

    def hold(self, press: JointPress | None) -> None:
        """See `PressMemory`."""
        self._memory.hold(press)

    def _press(self, rows: Array, poses: Poses, turn: Array, near: JointPress | None) -> JointPress | None:
        about = self._any.surroundings(rows, turn)
        found = {
            name: probe.around(rows, poses[name], turn, about, None if near is None else near.held_by(name))
            for name, probe in self.probes.items()
        }
        touching = {name: around for name, around in found.items() if around is not None}
        if not touching:
            return None
        names = tuple(touching)
        around, owner = _nearest(list(touching.values()))
        distances = tuple(ColliderDistance(self.probes[name].collider, poses[name]) for name in names)
        nearest = NearestDistance(distances, owner)
        problem = self._any.problem(rows, around, nearest)
        start = None
        if near is not None:
            start = near.predict(around.index[around.could_bear], problem, poses)
            if start is None:  # see `LoadProbe`
                return self._press(rows, poses, turn, None)
        press = self._any.balanced(rows, poses[names[0]], turn, around, nearest, problem, start)
        if not (press.bearing.size or around.reaches_in):
            return None
        return JointPress(press, names, dict(poses), owner[np.searchsorted(around.index, press.index)])

    def settled(self, rows: Array, poses: Poses, turn: Array) -> Callable[[IntArray], Array]:
        """See `LoadProbe.settled`."""
        joint = self.press(rows, poses, turn)
        return self._any.settled_by(None if joint is None else joint.press, rows, turn)


def _nearest(parts: list[Candidates]) -> tuple[Candidates, IntArray]:
    """Every load once, ascending, and the number of the part in which it is deepest. It could bear pressure if it could
    in any."""
    index = np.concatenate([part.index for part in parts])
    distance = np.concatenate([part.distance for part in parts])
    position = np.concatenate([part.position for part in parts])
    could_bear = np.concatenate([part.could_bear for part in parts])
    owner = np.repeat(np.arange(len(parts)), [len(part.index) for part in parts])
    order = np.lexsort((distance, index))
    starts = np.flatnonzero(np.r_[True, np.diff(index[order]) > 0])
    first = order[starts]
    anywhere = np.logical_or.reduceat(could_bear[order], starts)
    depth = max(part.depth for part in parts)
    return Candidates(index[first], distance[first], position[first], depth, anywhere), owner[first]
