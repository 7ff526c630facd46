"""What goes with a picture: the numbers of its step, as the window shows them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import RigidPose
from softprint.runtime.dynamics.state import ReducedState, StepResult


@dataclass(frozen=True, eq=False)
class Pace:
    """How fast the session runs. steps: a second of the wall clock; cost: of one step of all models [s];
    real: simulated time for each unit of real time."""

    steps: float = 0.0
    cost: float = 0.0
    real: float = 0.0


@dataclass(frozen=True, eq=False)
class FrameInfo:
    """model: its name; time: simulated [s]; poses: of the colliders; forces: on each of them (dim,) [N]; points
    (m, dim) [m] and sizes (m,) [N] of the contact forces; rows: of the handles; status, sentence: of the step; pull:
    both ends of the spring on a grabbed point; stamp: of the wall clock when the step began."""

    model: str
    time: float
    poses: Mapping[str, RigidPose]
    forces: Mapping[str, Array]
    points: Array
    sizes: Array
    rows: Array
    iterations: int
    residual: float
    status: str
    sentence: str
    pace: Pace
    pull: tuple[Array, Array] | None
    stamp: float

    @property
    def good(self) -> bool:
        """Whether the step converged, and no collider has pierced the body."""
        return self.status == "CONVERGED"


def frame_info(
    result: StepResult[ReducedState],
    model: str,
    pace: Pace,
    pull: tuple[Array, Array] | None,
    stamp: float,
) -> FrameInfo:
    """Of the result of a step."""
    dim = result.state.rows.shape[1]
    parts = [part for contact in result.contacts.values() for part in contact.parts if not part.tangential]
    points = np.concatenate([np.empty((0, dim)), *(part.points for part in parts)])
    forces = np.concatenate([np.empty((0, dim)), *(part.forces for part in parts)])
    sentence = "" if result.converged else result.reason
    return FrameInfo(
        model,
        result.state.time,
        dict(result.state.poses),
        {name: contact.force for name, contact in result.contacts.items()},
        points,
        np.linalg.norm(forces, axis=1),
        result.state.rows,
        result.iterations,
        result.residual,
        result.status.name,
        sentence,
        pace,
        pull,
        stamp,
    )
