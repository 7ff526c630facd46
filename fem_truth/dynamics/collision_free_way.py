"""The way of a body and its colliders through a step with contact by a barrier, part by part without collision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact import CoulombFriction
from softprint.runtime.dynamics.placed_collider import PlacedCollider, free_colliders
from softprint.runtime.errors import SoftprintError

if TYPE_CHECKING:
    from softprint.fem_truth.energy.barrier_contact import BarrierLaw, CollisionSurfaces
    from softprint.runtime.body import ReducedBody

# A part ends at this fraction of the way to the first collision.
_SHORT = 0.8
# If bodies that go on as before collide within this fraction, the body is left where it is instead.
_LEAST = 0.05


class CollisionFreeWay:
    """x: positions (n_nodes, dim) [m] that are reached, with the colliders at poses."""

    def __init__(self, surfaces: Mapping[str, CollisionSurfaces], x: Array, poses: Poses) -> None:
        self._surfaces, self.x, self.poses = surfaces, x, poses
        self._start, self._share = x, 1.0

    def require_apart(self) -> None:
        """Raises SoftprintError where a collider intersects the body."""
        for name, own in self._surfaces.items():
            own.require_apart(self.x, self.poses[name])

    def advance(self, target: Array, standing: Array, poses: Poses) -> tuple[bool, Array]:
        """Moves body and colliders towards a target (n_nodes, dim) and poses, as far as nothing collides; standing: the
        target of a body that does not move. Returns whether they arrive, and the positions of the body."""
        share = self._free(target, poses)
        if share < _LEAST:
            target = standing
            share = self._free(target, poses)
        arrived = share >= 1.0
        share = 1.0 if arrived else _SHORT * share
        # Points of a collider that turns do not quite move along lines.
        while self._free(self._between(target, share), self._posed(poses, share)) < 1.0:
            arrived, share = False, 0.5 * share
        x = self._between(target, share)
        self._start, self._share = self.x, share
        self.x, self.poses = x, poses if arrived else self._posed(poses, share)
        return arrived, x

    def continued(self, x: Array) -> Array:
        """Where the body would be at the end of the step if it went on as in the last part, which has led it to x."""
        before, self.x = self._start, x
        return x + (1.0 - self._share) / self._share * (x - before)

    def _between(self, target: Array, share: float) -> Array:
        return self.x + share * (target - self.x)

    def _posed(self, poses: Poses, share: float) -> Poses:
        return {name: pose.towards(poses[name], share) for name, pose in self.poses.items()}

    def _free(self, x: Array, poses: Poses) -> float:
        """The share of a motion to x and poses before the first collision."""
        return min(
            own.free_share(own.vertices(self.x, self.poses[name]), own.vertices(x, poses[name]))
            for name, own in self._surfaces.items()
        )


def surfaces_of(
    body: ReducedBody,
    colliders: Sequence[PlacedCollider],
    barrier: BarrierLaw,
    friction: CoulombFriction | None,
) -> dict[str, CollisionSurfaces]:
    """The surfaces of the body and of each collider. Raises SoftprintError for friction and for a collider that moves
    freely."""
    if friction is not None and friction.coefficient > 0:
        raise SoftprintError("contact by a barrier is without friction: set contact.friction = 0")
    for name in free_colliders(colliders):
        raise SoftprintError(
            f"collider {name!r} moves freely, which contact by a barrier cannot simulate: give it keyframes, or set "
            'contact.model = "penalty"'
        )
    from softprint.fem_truth.energy.barrier_contact import CollisionSurfaces  # needs the IPC Toolkit

    return {placed.name: CollisionSurfaces(body.mesh, placed.collider, barrier) for placed in colliders}
