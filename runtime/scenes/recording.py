"""Frames from a control loop of one's own, kept in memory, which are shown and converted as a motion file is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.state import StepResult
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

if TYPE_CHECKING:
    from softprint.runtime.drawing.picture import Animation


class Simulated(Protocol):
    """A `Simulator`, or another model of a body among colliders."""

    @property
    def body(self) -> ReducedBody: ...
    @property
    def colliders(self) -> Sequence[PlacedCollider]: ...
    @property
    def contact(self) -> PenaltyContact: ...

    def positions(self, state: Any) -> Array: ...


class Recording:
    """The frames that `add` is given. A frame takes 4 bytes for each coordinate of each node of the mesh.

    recording = softprint.Recording(simulator)
    recording.add(state)                          after every step, or every few
    recording.show()                              in a notebook
    softprint.convert_motion(recording, "press.glb")
    """

    def __init__(self, simulator: Simulated, label: str = "recording") -> None:
        self._simulator, self.label = simulator, label
        self._times: list[float] = []
        self._positions: list[NDArray[np.float32]] = []
        self._poses: dict[str, list[RigidPose]] = {placed.name: [] for placed in simulator.colliders}

    def add(self, state: Any) -> None:
        """Record a state of the simulator. Raises SoftprintError if it is none, or is not later than the last."""
        if isinstance(state, StepResult):
            raise SoftprintError("a recording takes states, and this is the result of a step: give result.state")
        if not hasattr(state, "poses") or state.poses.keys() != self._poses.keys():
            raise SoftprintError(
                f"this is no state of the recorded simulator, whose colliders are {', '.join(self._poses) or 'none'}"
            )
        if self._times and state.time <= self._times[-1]:
            raise SoftprintError(
                f"the recording is at {self._times[-1]:g} s, and this state at {state.time:g} s is not later"
            )
        self._positions.append(self._simulator.positions(state).astype(np.float32))
        self._times.append(float(state.time))
        for name, poses in self._poses.items():
            poses.append(state.poses[name])

    def __len__(self) -> int:
        return len(self._times)

    @property
    def times(self) -> Array:
        """(F,) [s]. Raises SoftprintError if nothing has been recorded."""
        if not self._times:
            raise SoftprintError(f"{self.label}: nothing has been recorded; add(state) records a frame")
        return np.array(self._times)

    @property
    def rest(self) -> Mesh:
        """The body at rest."""
        return self._simulator.body.mesh

    @property
    def contact(self) -> PenaltyContact:
        """The contact law of the simulator."""
        return self._simulator.contact

    def positions(self, frame: int) -> Array:
        """(n_nodes, dim) [m] of one frame."""
        return self._positions[frame].astype(np.float64)

    def poses(self) -> Mapping[str, Sequence[RigidPose]]:
        """The poses of every collider, by name."""
        return self._poses

    def build_colliders(self) -> dict[str, Collider]:
        """The colliders by name."""
        return {placed.name: placed.collider for placed in self._simulator.colliders}

    def show(self, colour: str = "displacement", width: int = 480) -> Animation:
        """As `Motion.show`."""
        from softprint.runtime.convert.show import animation_of

        return animation_of(self, colour, width)
