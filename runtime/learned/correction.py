"""What a correction is: displacement added to the reduced positions, and its derivative in the reduced state.

Everything that detail adds to the subspace goes through this protocol (thesis eq. 5.1, x = x_reduced + u). A
correction knows a body and one collider; *bound* to a set of material points it answers for these at a given
reduced state and collider pose. All of it is quasi-static: it has no velocity, and remembers nothing but where contact
came from (`FollowsContact`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np

from runtime.arrays import Array, BoolArray, IntArray, RowHessian
from runtime.body.body import ReducedBody
from runtime.body.material_points import MaterialPoints
from runtime.colliders.pose import RigidPose
from runtime.errors import SoftprintError
from runtime.mechanics.static_condensation import StaticCondensation
from runtime.rigid.twist import point_motion, turned_along


@dataclass(frozen=True, eq=False)
class CorrectionField:
    """A correction where it is active, linearised in the reduced state.

    index: (m,) which of the bound points; displacement: (m, dim) u [m], world frame;
    jacobian: (m, dim, n_rows, dim) du_a / d rows_rb, the collider held fixed.
    """

    index: IntArray
    displacement: Array
    jacobian: Array

    @classmethod
    def empty(cls, dim: int, n_rows: int) -> CorrectionField:
        """No point is active: the collider does not touch."""
        return cls(np.empty(0, dtype=np.int64), np.empty((0, dim)), np.empty((0, dim, n_rows, dim)))

    def by_twist(self, rows: Array, affine_part: Array, centre: Array) -> Array:
        """du/dtwist (m, dim, n_twist), the body held fixed: the collider moves by s and turns by w about the centre c
        (dim,) [m], translation first (`runtime/rigid/twist.py`).

        rows: (n_rows, dim), those of the linearisation; affine_part: o (n_rows,), see `Handles.affine_part`. A
        correction turns with body and collider together, so a twist is the body moved the other way and u turned along,

            du/dtwist = (0, E_k u) - du/drows (o I, E_k (rows - o c)),

        exact wherever du/drows is.
        """
        motion = point_motion(rows - affine_part[:, None] * centre)
        motion[:, :, : len(centre)] *= affine_part[:, None, None]
        through_rows = np.tensordot(self.jacobian, motion, axes=2)
        return np.asarray(turned_along(self.displacement) - through_rows)


def require_body(name: str, dim: int, n_rows: int, body: ReducedBody) -> None:
    """Raise SoftprintError where the correction `name`, of a body in dim dimensions with n_rows handle rows, is given
    another."""
    if (dim, n_rows) != (body.dim, body.n_rows):
        raise SoftprintError(
            f"correction {name!r} is for a {dim}D body with {n_rows} handle rows, but body "
            f"{body.name!r} is {body.dim}D with {body.n_rows}: train it for this body"
        )


class BoundCorrection(Protocol):
    """A correction at n fixed material points."""

    def displacement(self, rows: Array, pose: RigidPose, turn: Array | None = None) -> Array:
        """u (n, dim) [m] in the world frame at handle rows (n_rows, dim); zero where the correction is
        inactive. turn: as of `Potential`, by default that of the rows."""
        ...


class BoundField(BoundCorrection, Protocol):
    """One that dynamics can take along in a step."""

    def linearise(self, rows: Array, pose: RigidPose) -> CorrectionField:
        """u and du/drows of the active points; called once for each Newton step (DESIGN.md, part 9)."""
        ...


@runtime_checkable
class FollowsContact(Protocol):
    """One that knows where contact came from: of several equilibria it goes to the one next to the last state."""

    def begin(self) -> None:
        """Forget the last state."""
        ...

    def lead(self, rows: Array, pose: RigidPose) -> None:
        """Go to a state, on the way to the one whose displacement is asked for."""
        ...


class Potential(Protocol):
    """The energy of contact of one body with one collider, the detail condensed out: a function of the reduced
    state alone. Dynamics minimises it in place of penalty contact at corrected points.

    turn: (n_rows, dim), the handle rows at which the rotations of the body that its internal response follows are taken
    (`corotation.py`), held fixed in derivatives; nobody asks for it where there is no such response.
    """

    @property
    def nodes(self) -> IntArray:
        """(n_loads,) the nodes of the mesh where loads are."""
        ...

    def begin(self) -> None:
        """A motion begins: forget where contact came from."""
        ...

    def energy(self, rows: Array, pose: RigidPose, turn: Array) -> float:
        """W [J] at handle rows (n_rows, dim)."""
        ...

    def linearise(self, rows: Array, pose: RigidPose, turn: Array) -> tuple[float, Array, RowHessian | None]:
        """W [J], dW/drows (n_rows, dim) [N], Hessian (n_rows*dim, n_rows*dim) [N/m]; no Hessian out of contact."""
        ...

    def felt(
        self, rows: Array, pose: RigidPose, turn: Array, centre: Array
    ) -> tuple[Array, Callable[[], tuple[Array, Array]]]:
        """What the collider feels where it moves freely about its centre of mass (dim,): dW/dtwist (n_twist,), and as a
        function d2W/drows dtwist (n_rows*dim, n_twist) and d2W/dtwist2 (n_twist, n_twist), see
        `runtime/rigid/twist.py`."""
        ...

    def pressed(self, rows: Array, pose: RigidPose, turn: Array) -> ContactForces:
        """What pushes on the collider."""
        ...

    def settled(self, rows: Array, pose: RigidPose, turn: Array) -> Callable[[IntArray], Array]:
        """Where points are in a state, dent included: (m, dim) [m] as a function of their numbers (m,), which are
        those of `ContactForces`."""
        ...


@dataclass(frozen=True, eq=False)
class ContactForces:
    """The m points that bear pressure. index: (m,) their numbers; position, normal: (m, dim) where they are and the
    gradient of the signed distance there, world frame; moving: finds (m, dim, n_rows*dim) d position / d rows, the dent
    carried along as it is; pressure: p (m,) [N]; left: penetration that is left (m,) > 0 [m]."""

    index: IntArray
    position: Array
    moving: Callable[[], Array]
    normal: Array
    pressure: Array
    left: Array

    def take(self, which: BoolArray) -> ContactForces:
        """Some of them (m,)."""
        return ContactForces(
            self.index[which],
            self.position[which],
            lambda: self.moving()[which],
            self.normal[which],
            self.pressure[which],
            self.left[which],
        )

    @classmethod
    def none(cls, n_rows: int, dim: int) -> ContactForces:
        """Nothing is pressed."""
        nowhere, nothing = np.empty((0, dim)), np.empty(0)
        still = np.empty((0, dim, n_rows * dim))
        return cls(np.empty(0, dtype=np.int64), nowhere, lambda: still, nowhere, nothing, nothing)


class Correction(Protocol):
    """A learned displacement field. `collider` names the collider it was learned for; beyond the signed
    distance `support` [m] from that collider it is exactly zero (inf: no such distance). potential: the energy of
    contact that goes with the field, None where contact is penalty at corrected points (thesis 5.4). internal: the
    internal response of the body, to which the field of contact adds; None where that is taken from U q."""

    name: str
    collider: str
    support: float
    potential: Potential | None
    internal: StaticCondensation | None

    def bind(self, points: MaterialPoints) -> BoundCorrection:
        """The correction at these points, prepared once."""
        ...


class FieldCorrection(Correction, Protocol):
    """A correction without a potential: bodies touch at corrected points."""

    def bind(self, points: MaterialPoints, reach: float | Array = np.inf) -> BoundField:
        """Points whose *reduced* position is farther than `reach` [m] from the collider (one number, or (n,) one a
        point) count as inactive: contact points need the correction only where they could touch."""
        ...


def is_field(correction: Correction) -> TypeGuard[FieldCorrection]:
    """Whether contact is penalty at corrected points."""
    return correction.potential is None
