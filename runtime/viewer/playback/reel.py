"""What can be played: a row of pictures of one body, from a motion file or a truth file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders import Collider, RigidPose
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.viewer.session.painting import drawn_nodes

DISPLACEMENT, DIFFERENCE, PRESSURE, STRAIN = "displacement", "difference", "contact pressure", "strain"
UNITS = {DISPLACEMENT: "mm", DIFFERENCE: "mm", PRESSURE: "kPa", STRAIN: "", "nothing": ""}


@dataclass(frozen=True, eq=False)
class Still:
    """One picture. positions: (n_nodes, dim) [m]; poses: of the colliders; title: one line; bad: whether its solve did
    not converge, or a collider has pierced the body."""

    positions: Array
    poses: Mapping[str, RigidPose]
    title: str
    bad: bool = False


class Reel(Protocol):
    """name: for the page; rest: the mesh at rest; times: (count,) [s], None where there is no time; quantities: that it
    can be coloured by; forces: (count,) [N] of all colliders together, None if not known."""

    name: str
    rest: Mesh
    colliders: Mapping[str, Collider]
    times: Array | None
    forces: Array | None
    quantities: tuple[str, ...]

    @property
    def count(self) -> int: ...

    def still(self, index: int) -> Still:
        """One picture of it."""
        ...

    def values(self, index: int, still: Still, quantity: str) -> Array:
        """(n,) at the drawn nodes, in the unit of `UNITS`; NaN where there is none."""
        ...


@dataclass(eq=False)
class Measured:
    """Values at the drawn nodes of a mesh."""

    rest: Mesh
    nodes: IntArray = field(init=False)

    def __post_init__(self) -> None:
        self.nodes = drawn_nodes(self.rest)

    def displacement(self, positions: Array) -> Array:
        """(n,) [mm] from rest."""
        moved = positions[self.nodes] - self.rest.points[self.nodes]
        return np.asarray(1e3 * np.linalg.norm(moved, axis=1))

    def strain(self, positions: Array) -> Array:
        """(n,) |E| of the Green strain."""
        F = np.stack([derivative @ positions for derivative in self._derivatives], axis=-1)
        strain = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(self.rest.dim))
        return np.asarray(np.sqrt((strain * strain).sum(axis=(1, 2))))

    @cached_property
    def _derivatives(self) -> list[Array]:
        return [derivative.tocsr()[self.nodes] for derivative in self.rest.nodal_gradient]
