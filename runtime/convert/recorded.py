"""What can be converted: a motion file, or frames recorded in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.mesh import Mesh


class Recorded(Protocol):
    """F frames of one body and its colliders."""

    @property
    def label(self) -> str:
        """What it is, for messages and for the metadata of files."""
        ...

    @property
    def times(self) -> Array:
        """(F,) [s], increasing."""
        ...

    @property
    def rest(self) -> Mesh:
        """The body at rest."""
        ...

    @property
    def contact(self) -> PenaltyContact:
        """The contact law, for the pressure."""
        ...

    def positions(self, frame: int) -> Array:
        """(n_nodes, dim) [m]."""
        ...

    def poses(self) -> Mapping[str, Sequence[RigidPose]]:
        """The F poses of every collider, by name."""
        ...

    def build_colliders(self) -> Mapping[str, Collider]:
        """The colliders by name. Raises SoftprintError if one of them cannot be built."""
        ...
