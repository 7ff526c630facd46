"""The state of a simulation in full space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.rigid.flight import RigidMotion


@dataclass(frozen=True, eq=False)
class FullSpaceState:
    """time [s]; x (n_nodes, dim) positions [m]; velocity (n_nodes, dim) [m/s]; poses: of all colliders at this time;
    motions: of the colliders that move freely."""

    time: float
    x: Array
    velocity: Array
    poses: Poses
    motions: Mapping[str, RigidMotion] = field(default_factory=dict)
