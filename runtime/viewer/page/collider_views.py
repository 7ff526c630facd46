"""The colliders in the scene of the page, the gizmo on one of them, and how a mouse leads them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import Collider, RigidPose
from softprint.runtime.drawing.colours import COLLIDER
from softprint.runtime.viewer.page.palette import rgb
from softprint.runtime.viewer.page.solids import drawn_solid, in_space

if TYPE_CHECKING:
    import viser

Lead = Callable[[str, Array, "Array | None"], None]

_OPACITY = 0.45


@dataclass(frozen=True)
class Shown:
    """A collider and how it is told from another of the same name."""

    name: str
    key: str
    collider: Collider


class ColliderViews:
    """Draws colliders beside each of the bodies. lead(name, position (dim,), rotation (dim, dim) or None): asked when
    the mouse moves one, None where they cannot be led; offsets (3,) of the bodies; size [m] of the body; folder: of
    the nodes in the scene."""

    def __init__(
        self,
        server: viser.ViserServer,
        dim: int,
        size: float,
        offsets: Sequence[Array],
        lead: Lead | None,
        folder: str = "colliders",
    ) -> None:
        self._server, self._dim, self._size, self._lead, self._folder = server, dim, size, lead, folder
        self.offsets = list(offsets)
        self._shown: dict[str, Shown] = {}
        self._nodes: dict[str, list[Any]] = {}
        self._poses: dict[str, RigidPose] = {}
        self._gizmo: Any = None
        self.held: str | None = None
        self._dragging = self._placed = False

    def have(self, shown: Sequence[Shown], count: int) -> None:
        """Show exactly these colliders beside `count` bodies."""
        wanted = {own.name: own for own in shown}
        for name in list(self._shown):
            old = self._shown[name]
            if name not in wanted or wanted[name].key != old.key or len(self._nodes[name]) != count:
                for node in self._nodes.pop(name):
                    node.remove()
                del self._shown[name]
        for own in shown:
            if own.name not in self._shown:
                self._shown[own.name] = own
                self._nodes[own.name] = [self._add(own, number) for number in range(count)]
        if self.held not in wanted:
            self.hold(next((own.name for own in shown if np.isfinite(own.collider.upper).all()), None))

    def hold(self, name: str | None) -> None:
        """Put the gizmo on a collider."""
        if self._gizmo is not None:
            self._gizmo.remove()
            self._gizmo = None
        self.held, self._dragging, self._placed = name, False, False
        if name is None or self._lead is None or name not in self._shown:
            return
        reach = self._shown[name].collider.size
        gizmo = self._server.scene.add_transform_controls(
            "/gizmo",
            scale=1.35 * reach,
            line_width=3.0,
            active_axes=(True, True, self._dim == 3),
            depth_test=False,
            opacity=0.8,
        )
        self._gizmo = gizmo
        if name in self._poses:
            self._place_gizmo(self._poses[name])

        @gizmo.on_update
        async def _(event: Any) -> None:
            self._dragging = event.phase != "end"
            if event.phase != "start":
                position = np.asarray(event.target.position, dtype=float) - self.offsets[0]
                self._ask(name, position, rotation_of(event.target.wxyz))

    def place(self, number: int, poses: Mapping[str, RigidPose]) -> None:
        """Show the colliders of one body at these poses."""
        for name, nodes in self._nodes.items():
            pose = poses.get(name)
            if pose is None or number >= len(nodes):
                continue
            position, wxyz = in_space(pose)
            nodes[number].position = position + self.offsets[number]
            nodes[number].wxyz = wxyz
            if number == 0:
                self._poses[name] = pose

    def renew(self) -> None:
        """Put the gizmo where its collider is at the next picture, as after a reset."""
        self._placed = False

    def follow(self, free: bool) -> None:
        """The gizmo goes where its collider is, unless it is being dragged; a led one stays where it is wished."""
        if (free or not self._placed) and not self._dragging and self.held in self._poses:
            self._place_gizmo(self._poses[self.held])

    def wish(self, name: str, pose: RigidPose) -> None:
        """A collider has been led otherwise than by the gizmo."""
        if name == self.held and not self._dragging:
            self._place_gizmo(pose)

    def _place_gizmo(self, pose: RigidPose) -> None:
        if self._gizmo is not None:
            position, wxyz = in_space(pose)
            self._gizmo.position, self._gizmo.wxyz = position + self.offsets[0], wxyz
            self._placed = True

    def _add(self, own: Shown, number: int) -> Any:
        vertices, faces = drawn_solid(own.collider, self._size)
        node = self._server.scene.add_mesh_simple(
            f"/{self._folder}/{own.name}_{number}",
            np.asarray(vertices, dtype=np.float32),
            np.asarray(faces, dtype=np.uint32),
            color=rgb(COLLIDER),
            opacity=_OPACITY,
            side="double" if self._dim == 2 else "front",
            cast_shadow=False,
        )
        if self._lead is not None:
            self._drag_with_the_mouse(own.name, node)
        return node

    def _drag_with_the_mouse(self, name: str, node: Any) -> None:
        """A drag moves the collider in the plane of the screen."""
        began: dict[str, Array] = {}

        @node.on_drag
        async def _(event: Any) -> None:
            end = np.asarray(event.end_position, dtype=float)
            if event.phase == "start":
                began["at"], began["pose"] = end, in_space(self._poses[name])[0]
                if self.held != name:
                    self.hold(name)
            elif "at" in began:
                self._ask(name, began["pose"] + end - began["at"], None)
                if event.phase == "end":
                    began.clear()

    def _ask(self, name: str, position: Array, rotation: Array | None) -> None:
        assert self._lead is not None
        own = None if rotation is None else rotation[: self._dim, : self._dim]
        self._lead(name, position[: self._dim], own)
        if rotation is None and name in self._poses:  # the gizmo goes along
            pose = self._poses[name]
            if np.isfinite(position).all():
                self.wish(name, RigidPose.known(pose.rotation, position[: self._dim].copy()))


def rotation_of(wxyz: Any) -> Array:
    """(3, 3); not a rotation where the numbers are none, which the session then refuses."""
    from scipy.spatial.transform import Rotation

    quaternion = np.roll(np.asarray(wxyz, dtype=float), -1)
    if not (np.isfinite(quaternion).all() and np.linalg.norm(quaternion) > 1e-6):
        return np.full((3, 3), np.nan)
    return np.asarray(Rotation.from_quat(quaternion).as_matrix())
