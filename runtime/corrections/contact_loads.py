"""What a load model is told of a contact: the loads near the collider, and what mechanics makes of them.

More loads than bear pressure take part, all within a band around the collider, so that what is learned can push where
the linear body is not pushed. The last answer is kept, because the same state is asked for at several sets of points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.corrections.load_press import LoadProbe
from runtime.corrections.points import PointStates, PointTensors, collider_rows
from runtime.corrections.rest_mechanics import RestMechanics


@dataclass(frozen=True, eq=False)
class ContactLoads:
    """index: (m,) loads of the body; state: of their points; load: (m, dim) [N] in rest coordinates, moved: (m, dim)
    [m] in collider space and left: (m,) [m], penetration left (negative: a gap), of the contact that mechanics gives.
    All float64."""

    index: IntArray
    state: PointStates
    load: Tensor
    moved: Tensor
    left: Tensor
    areas: Tensor
    band: float

    @property
    def weight(self) -> Tensor:
        """(m,) area times x^2 / (1 + x^2), x = 1 - s / band: C1, zero at the band's edge."""
        x = (1.0 - self.state.sdf / self.band).clamp(min=0.0)
        return self.areas * x**2 / (1.0 + x**2)

    @property
    def depth(self) -> Tensor:
        """D () [m] = sum a d^3 / sum a d^2 of the depths d of the undisplaced loads: how deep it is as a whole;
        loads enter and leave it smoothly."""
        d = (-self.state.sdf).clamp(min=0.0)
        return (self.areas @ d**3) / (self.areas @ d**2)


class ContactLoadsProbe:
    """Measures `ContactLoads` for one body and one collider.

    stiffness: of the penalty contact [N/m^4]; band: [m], loads up to this far outside the collider take part.
    """

    def __init__(
        self,
        body: ReducedBody,
        collider: Collider,
        mechanics: RestMechanics,
        stiffness: float,
        band: float,
    ) -> None:
        self.loads = LoadProbe(body, collider, mechanics, stiffness, band)
        self.collider, self._band = collider, band
        self._affine_part = body.handles.affine_part
        self._areas = mechanics.compliance.areas
        self._last: tuple[Array, RigidPose, Array, ContactLoads | None] | None = None

    def measure(self, rows: Array, pose: RigidPose, turn: Array | None = None) -> ContactLoads | None:
        """The loads at handle rows (n_rows, dim), or None where no load is inside the collider. turn: of the body,
        that of the rows themselves by default."""
        turn = self.loads.turn(rows) if turn is None else turn
        if self._last is not None:
            last_rows, last_pose, last_turn, loads = self._last
            if last_pose is pose and np.array_equal(last_rows, rows) and np.array_equal(last_turn, turn):
                return loads
        loads = self._measure(rows, pose, turn)
        self._last = (rows.copy(), pose, turn, loads)
        return loads

    def collider_rows(self, rows: Array, pose: RigidPose) -> Array:
        """T^-1 q (n_rows, dim)."""
        return collider_rows(rows, self._affine_part, pose)

    def _measure(self, rows: Array, pose: RigidPose, turn: Array) -> ContactLoads | None:
        probe = self.loads
        press = probe.press(rows, pose, turn)
        if press is None:
            return None
        index = press.around
        x = probe.positions(rows, turn, index)
        pressed = press.index[press.bearing]
        given = np.tensordot(probe.among(index, pressed), press.load, 2)
        moved = (probe.deformation(rows, index) @ given[..., None])[..., 0]
        left = -self.collider.sdf(pose.apply_inverse(x + moved))
        load = np.zeros_like(moved)
        load[np.searchsorted(index, pressed)] = press.load
        state = PointStates.at(
            PointTensors.of(probe.points.take(index), torch.zeros((), dtype=torch.float64)),
            self.collider_rows(rows, pose),
            pose.apply_inverse(x),
            self.collider,
        )
        return ContactLoads(
            index=index,
            state=state,
            load=torch.from_numpy(load),
            moved=torch.from_numpy(pose.rotate_inverse(moved)),
            left=torch.from_numpy(left),
            areas=torch.from_numpy(self._areas[index]),
            band=self._band,
        )
