"""What hands do to a body: the colliders that they lead, the handles, and the spring on a point that they grab."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders import RigidPose
from softprint.runtime.dynamics.kinematic import KinematicHandle
from softprint.runtime.dynamics.terms.springs import HandleSpring, PointSpring
from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.scene import SceneParts
from softprint.runtime.viewer.session.follower import Follower
from softprint.runtime.viewer.session.led_path import LedPath
from softprint.runtime.viewer.session.painting import drawn_nodes

# Speed limit of what is led, in sizes of the body a second: at 60 steps a second a tenth of it each step would pass
# through a surface unseen, a fiftieth does not.
_SPEED = 4.0
# Of the spring on a grabbed point, as a share of Young's modulus times the size of the body [N/m].
_STIFFNESS = 1.0
# The end of that spring stays within so many sizes of the body from where it began: farther, and it turns cells inside
# out.
_FARTHEST = 0.5


@dataclass(frozen=True, eq=False)
class Grab:
    """The point of the body that is pulled. node: of the mesh; start: where it was grabbed (dim,) [m]; follower:
    where it is pulled to."""

    node: int
    start: Array
    stiffness: float
    follower: Follower


class Hands:
    """Followers of everything that is led. A target that is no number raises SoftprintError and changes nothing."""

    def __init__(self, body: ReducedBody, parts: SceneParts, poses: Mapping[str, RigidPose]) -> None:
        self.body, self._parts = body, parts
        self.speed = _SPEED * body.mesh.size
        self.colliders = {name: Follower(pose, self.speed) for name, pose in poses.items()}
        self.handles: dict[int | str, LedPath] = {}
        self.grab: Grab | None = None

    def place(self, poses: Mapping[str, RigidPose]) -> None:
        """Have exactly these colliders, at these poses at once."""
        self.colliders = {name: Follower(pose, self.speed) for name, pose in poses.items()}

    def lead_collider(self, name: str, position: Array, rotation: Array | None) -> None:
        """Wish a collider at a pose; without a rotation it keeps the one it is wished at."""
        if name not in self.colliders:
            raise SoftprintError(f"there is no collider {name!r} in the scene")
        follower = self.colliders[name]
        turned = follower.target.rotation if rotation is None else rotation
        follower.target = self._pose(turned, position)

    def lead_handle(
        self, handle: int | str, displacement: Array, rotation: Array | None, rows: Array
    ) -> bool:
        """Wish a handle displaced from rest; whether it was not led before. rows: of the body now."""
        new = handle not in self.handles
        if new:
            self.handles[handle] = LedPath(Follower(self._displacement(handle, rows), self.speed))
        follower = self.handles[handle].follower
        turned = follower.target.rotation if rotation is None else rotation
        try:
            follower.target = self._pose(turned, displacement)
        except SoftprintError:
            if new:
                del self.handles[handle]
            raise
        return new

    def grab_body(self, point: Array, stiffness: float | None, rows: Array) -> None:
        """Put a spring on the drawn node nearest to a point (dim,)."""
        point = self._vector(point)
        body = self.body
        nodes = drawn_nodes(body.mesh)
        distance = np.linalg.norm(body.basis[nodes] @ rows - point, axis=1)
        node = int(nodes[np.argmin(distance)])
        if stiffness is None:
            young = float(np.mean(body.material.young))
            stiffness = _STIFFNESS * young * body.mesh.size ** (body.dim - 2)
        if not (np.isfinite(stiffness) and stiffness > 0):
            raise SoftprintError(f"the stiffness of the pull must be a positive number, not {stiffness}")
        at = RigidPose.known(np.eye(body.dim), body.basis[node] @ rows)
        self.grab = Grab(node, at.translation, stiffness, Follower(at, self.speed))

    def pull_body(self, target: Array) -> None:
        """Wish the end of the spring at a point (dim,)."""
        target = self._vector(target)
        if self.grab is not None:
            way = target - self.grab.start
            share = min(1.0, _FARTHEST * self.body.mesh.size / max(float(np.linalg.norm(way)), 1e-12))
            self.grab.follower.target = RigidPose.known(np.eye(self.body.dim), self.grab.start + share * way)

    def advance(self, seconds: float) -> dict[str, RigidPose]:
        """The poses of all colliders after so many seconds; handles and the spring follow, too."""
        for path in self.handles.values():
            path.follower.advance(seconds)
        if self.grab is not None:
            self.grab.follower.advance(seconds)
        return {name: follower.advance(seconds) for name, follower in self.colliders.items()}

    @property
    def springs(self) -> list[HandleSpring | PointSpring]:
        """Those of the scene, and that of the grabbed point."""
        springs: list[HandleSpring | PointSpring] = [*self._parts.springs]
        if self.grab is not None:
            weights = self.body.basis[self.grab.node]
            springs.append(PointSpring(weights, self.grab.stiffness, LedPath(self.grab.follower)))
        return springs

    @property
    def kinematic(self) -> list[KinematicHandle]:
        """The led handles, and those of the scene that are not led."""
        led = [KinematicHandle(handle, path) for handle, path in self.handles.items()]
        return [*led, *(fixed for fixed in self._parts.kinematic if fixed.handle not in self.handles)]

    def _displacement(self, handle: int | str, rows: Array) -> RigidPose:
        """Of a handle from rest, as the path of a kinematic handle gives it."""
        handles, rest = self.body.handles, self.body.rest_rows
        moved = handles.position(rows, handle) - handles.position(rest, handle)
        rotation = np.eye(self.body.dim)
        if isinstance(handle, str):
            rotation = rows[handles.rows_of(handle)][:-1].T
        return RigidPose(rotation, moved)

    def _vector(self, values: Array) -> Array:
        vector = np.asarray(values, dtype=float)
        if vector.shape != (self.body.dim,) or not np.isfinite(vector).all():
            raise SoftprintError(f"a position here is {self.body.dim} finite numbers, not {vector.tolist()}")
        return vector

    def _pose(self, rotation: Array, position: Array) -> RigidPose:
        return RigidPose(np.asarray(rotation, dtype=float), self._vector(position))
