"""What a load model is told of a contact: the loads near the collider, and what mechanics makes of them.

More loads than bear pressure take part, all within a band around the collider, so that what is learned can push where
the linear body is not pushed. The last answer is kept, because the same state is asked for at several sets of points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array, BoolArray, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.colliders.pose import RigidPose
from runtime.contact.condensed.candidates import Candidates
from runtime.contact.condensed.contact_node_kernels import are_among
from runtime.contact.condensed.equilibrium import ContactEquilibrium, LoadProbe
from runtime.contact.condensed.joint_press import JointPress
from runtime.elasticity.invariants import cofactor
from runtime.learned.deformed_normal import SHORTEST
from runtime.learned.force.inputs import RANGE, contact_inputs, inputs_around
from runtime.mechanics.body_mechanics import BodyMechanics


@dataclass(frozen=True, eq=False)
class ContactState:
    """index: (m,) loads of the body; load: l (m, dim) [N], what mechanics gives them, in rest coordinates; inputs: a
    (m, n_contact_inputs(dim)), see `inputs.py`; lever: w F^T v_k (m, DIRECTIONS, dim) [m^(dim-1)] with the directions
    v = g, N and u / band of `inputs.py` and w = area x^2 / (1 + x^2), x = 1 - distance / band, C1 and zero at the
    band's edge; depth: D [m], see `patch_depth`. Corotation body and collider together changes none of these."""

    index: IntArray
    load: Array
    inputs: Array
    lever: Array
    depth: float


@dataclass(frozen=True, eq=False)
class UnmeasuredContact:
    """What there is to be measured, as plain data: n loads `index` about a collider at pose, undisplaced at position
    (n, dim) [m] while the handle rows are rows; F^T f = load (k, dim) [N] of all loads pressed (k,) on the body, and
    which of these press on this collider."""

    rows: Array
    pose: RigidPose
    index: IntArray
    position: Array
    pressed: IntArray
    load: Array
    mine: BoolArray


def patch_depth(areas: Array, distance: Array) -> float:
    """D [m] = sum a d^3 / sum a d^2 of the depths d of undisplaced loads at signed distances (m,): how deep a contact
    is as a whole; loads enter and leave it smoothly. 0 where none is inside."""
    d = np.maximum(-distance, 0.0)
    return float(areas @ d**3 / (areas @ d**2)) if d.any() else 0.0


class ContactStateProbe:
    """Measures `ContactState` for one body and one collider.

    stiffness: of the penalty contact [N/m^4]; band: [m], loads up to this far outside the collider take part.
    """

    def __init__(
        self,
        body: ReducedBody,
        collider: Collider,
        mechanics: BodyMechanics,
        stiffness: float,
        band: float,
    ) -> None:
        self.loads = LoadProbe(body, collider, mechanics, stiffness, band)
        self.collider, self._band = collider, band
        self._areas = mechanics.compliance.areas
        self._pressed: tuple[ContactEquilibrium, UnmeasuredContact] | None = None
        self._measured: tuple[UnmeasuredContact, ContactState] | None = None

    def measure(
        self, rows: Array, pose: RigidPose, turn: Array | None = None, joint: JointPress | None = None
    ) -> ContactState | None:
        """The loads at handle rows (n_rows, dim), or None where no load is inside the collider. turn: of the body,
        that of the rows themselves by default; joint: in which this collider is pressed together with others."""
        found = self.pressed(rows, pose, turn, joint)
        return None if found is None else self.measured(found)

    def begin(self) -> None:
        """Forget what was pressed before. Loads may be in balance in several ways: of these they come to the one next
        to the last, as bodies do."""
        self.loads.begin()

    def lead(self, rows: Array, pose: RigidPose) -> None:
        """Press the loads at a state on the way to another, and measure nothing."""
        self.loads.press(rows, pose, rows)

    def pressed(
        self, rows: Array, pose: RigidPose, turn: Array | None = None, joint: JointPress | None = None
    ) -> UnmeasuredContact | None:
        """The loads, pressed and not yet measured."""
        turn = rows if turn is None else turn
        if joint is None:
            press = self.loads.press(rows, pose, turn)
            return None if press is None else self._alone(press, rows, pose)
        name, press = self.collider.name, joint.press
        mine = joint.borne_by(name)
        around = self.loads.around(rows, pose, turn, held=joint.held_by(name))
        if around is None and not mine.any():
            return None
        around = around or Candidates.nowhere(rows.shape[1])
        # What the collider holds that it does not push in is about it, too.
        missed = mine & ~are_among(press.pressed, around.index)
        around = around.joined_by(press.pressed[missed], press.problem.position[press.bearing[missed]])
        return UnmeasuredContact(rows, pose, around.index, around.position, press.pressed, press.load, mine)

    def _alone(self, press: ContactEquilibrium, rows: Array, pose: RigidPose) -> UnmeasuredContact:
        """The same for the same press, so that it is measured once, whoever asks."""
        if self._pressed is None or self._pressed[0] is not press:
            everyone = np.ones(press.bearing.size, dtype=bool)
            around = press.around, press.around_position
            self._pressed = (
                press,
                UnmeasuredContact(rows, pose, *around, press.pressed, press.load, everyone),
            )
        return self._pressed[1]

    def measured(self, loads: UnmeasuredContact) -> ContactState:
        """Of loads that were pressed, on any thread or in another process, wherever others are pressed by then."""
        last = self._measured
        if last is None or last[0] is not loads:
            self._measured = last = loads, self._measure(loads)
        return last[1]

    def _measure(self, loads: UnmeasuredContact) -> ContactState:
        probe = self.loads
        index, pose, m = loads.index, loads.pose, len(loads.index)
        F = pose.rotation.T @ probe.loads.deformation(loads.rows, index)
        moved = probe.moved_by(loads.pressed, loads.load, index, F)
        z = pose.apply_inverse(loads.position)
        distance, slope, curvature = self.collider.sdf_derivatives(np.concatenate([z, z + moved]))
        load = np.zeros_like(moved)
        load[np.searchsorted(index, loads.pressed[loads.mine])] = loads.load[loads.mine]
        carried = (cofactor(F) @ probe.points.surface_normal[index][..., None])[..., 0]
        length = np.sqrt((carried * carried).sum(axis=1, keepdims=True))
        carried /= np.maximum(length, SHORTEST)
        x = np.maximum(1.0 - distance[:m] / self._band, 0.0) ** 2
        weight = self._areas[index] * x / (1.0 + x)
        normal, rest = probe.points.surface_normal[index], probe.points.rest[index]
        inputs = (
            contact_inputs(distance, slope, curvature, moved, F, carried, normal),
            inputs_around(z, weight, distance, slope, moved, carried, RANGE * self._band),
            rest,
        )
        directions = np.stack([slope[:m], carried, moved / self._band], axis=1)
        lever = weight[:, None, None] * (directions @ F)
        depth = patch_depth(self._areas[index], distance[:m])
        return ContactState(index, load, np.concatenate(inputs, axis=1), lever, depth)
