"""A solved contact as plain data: a state stores it from step to step, and deformed positions are drawn from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.contact.solver import contact_solve_kernels as kernels
from softprint.runtime.contact.solver.candidates import ActiveSet
from softprint.runtime.contact.solver.contact_solve import ContactSolution
from softprint.runtime.contact.solver.pressed_points import PressedPoints
from softprint.runtime.lazy import lazy


@dataclass(frozen=True, eq=False)
class NearPoints:
    """Contact points (n,), ascending, near a collider at a pose, and their positions without contact displacement (n,
    dim) [m]."""

    pose: RigidPose
    index: IntArray
    position: Array


@dataclass(frozen=True, eq=False)
class SolvedContact:
    """The contact of a body at handle rows (n_rows, dim) with the colliders of a scene, by name.

    frame_rows: (n_rows, dim) of the corotated frame; poses: of all colliders; near: the points near those that it
    touches; index: (m,), ascending, the points that took part in the contact solve; owner: (m,) number of the collider
    of each; position: x (m, dim) [m] and carriers A (m, dim, dim) of these points, see `contact_points.py`; depth:
    estimate of the contact displacement [m]; solution: of these points; pressed: those that sharp points of the
    colliders press, None without any; followed: whether Newton's method followed it all the way from where its last
    solve started.
    """

    rows: Array
    frame_rows: Array
    poses: Poses
    near: Mapping[str, NearPoints]
    index: IntArray
    owner: IntArray
    position: Array
    carriers: Array
    depth: float
    solution: ContactSolution
    pressed: PressedPoints | None
    followed: bool

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the colliders, in the numbering of `owner`."""
        return tuple(self.near)

    @lazy
    def active(self) -> IntArray:
        """(k,) the contact points that carry pressure."""
        return self.index[self.solution.active]

    @lazy
    def deformed_position(self) -> Array:
        """Deformed positions y (m, dim) [m]."""
        return np.asarray(self.position + self.solution.displacement)

    @lazy
    def rest_force(self) -> Array:
        """A^T f (k, dim) [N] on the active points."""
        b, solution = self.solution.active, self.solution
        return kernels.pulled_back(self.carriers[b], solution.pressure[b], solution.normal[b])

    def owned_by(self, name: str) -> BoolArray:
        """(k,) which of the active points touch the collider."""
        if name not in self.near:
            return np.zeros(len(self.active), dtype=bool)
        return np.equal(self.owner[self.solution.active], self.names.index(name))

    def active_set(self, name: str) -> ActiveSet | None:
        """The active set of one collider on the facets, for the next solve; None where the body does not touch it."""
        if name not in self.near:
            return None
        b, solution = self.solution.active, self.solution
        everything = ActiveSet(
            self.active, self.carriers[b], solution.normal[b], solution.largest_displacement
        )
        if len(self.near) == 1 and self.pressed is None:
            return everything
        return everything.take(self.owned_by(name) & ~self.is_pressed)

    @lazy
    def is_pressed(self) -> BoolArray:
        """(k,) which of the active points sharp points of the colliders press."""
        if self.pressed is None:
            return np.zeros(len(self.active), dtype=bool)
        return np.greater_equal(self.active, self.pressed.first)
