"""The colliders of a scene: led along paths, posed by the caller, or free to move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from runtime.colliders.collider import Collider
from runtime.colliders.path import KeyframedPath
from runtime.colliders.pose import Poses, RigidPose
from runtime.errors import SoftprintError
from runtime.learned.correction import Correction, is_field
from runtime.rigid.flight import RigidMotion
from runtime.rigid.free_collider import FreeCollider


@dataclass(frozen=True, eq=False)
class PlacedCollider:
    """A collider in the scene. path: where it is over time, None where the caller gives its pose with every
    step; correction: what was learned about its contact with this body; free: its mass and its start, where it moves as
    forces have it."""

    name: str
    collider: Collider
    path: KeyframedPath | None = None
    correction: Correction | None = None
    free: FreeCollider | None = None


def free_colliders(colliders: Sequence[PlacedCollider]) -> dict[str, FreeCollider]:
    """Those that move freely, by name."""
    return {placed.name: placed.free for placed in colliders if placed.free is not None}


def starting_motions(colliders: Sequence[PlacedCollider]) -> dict[str, RigidMotion]:
    """How the free ones move at the start."""
    return {name: free.motion for name, free in free_colliders(colliders).items()}


def poses_at(
    colliders: Sequence[PlacedCollider], time: float, poses: Mapping[str, RigidPose] | None
) -> Poses:
    """Where every collider is at ``time`` [s]: the given pose, or else that of its path; of free ones that of the
    start."""
    given = dict(poses or {})
    placed = {}
    for collider in colliders:
        if collider.name in given:
            placed[collider.name] = given.pop(collider.name)
        elif collider.free is not None:
            placed[collider.name] = collider.free.pose
        elif collider.path is not None:
            placed[collider.name] = collider.path.pose(time)
        else:
            raise SoftprintError(f"collider {collider.name!r} has no path: give its pose with every step")
    if given:
        raise SoftprintError(f"a pose was given for {', '.join(given)}, which is no collider of this scene")
    return placed


def poses_after(
    colliders: Sequence[PlacedCollider], time: float, poses: Mapping[str, RigidPose] | None, before: Poses
) -> Poses:
    """Where every collider is at the end of a step, at ``time`` [s]; free ones where they were before, for the step to
    move them."""
    free = free_colliders(colliders)
    led = [name for name in free if name in (poses or {})]
    if led:
        raise SoftprintError(
            f"collider {led[0]!r} moves freely: leave its pose to the step, or place it without a density and a mass"
        )
    return poses_at(colliders, time, {**(poses or {}), **{name: before[name] for name in free}})


def check_colliders(colliders: Sequence[PlacedCollider], dim: int) -> None:
    """SoftprintError for names, dimensions or corrections that do not fit together."""
    names = [placed.name for placed in colliders]
    if len(set(names)) != len(names):
        raise SoftprintError(
            f"two colliders of the scene have the same name; the names are {', '.join(names)}"
        )
    for placed in colliders:
        if placed.collider.dim != dim or (placed.path is not None and placed.path.dim != dim):
            raise SoftprintError(f"collider {placed.name!r} and its path must be {dim}D, as the body is")
        if placed.free is not None and placed.path is not None:
            raise SoftprintError(f"collider {placed.name!r} moves freely, and so can have no path")
        correction = placed.correction
        if correction is None:
            continue
        if correction.collider != placed.collider.name:
            raise SoftprintError(
                f"correction {correction.name!r} was learned for collider {correction.collider!r}, "
                f"not for {placed.collider.name!r}"
            )
        if placed.free is not None and is_field(correction):
            raise SoftprintError(
                f"correction {correction.name!r} says nothing of how it changes with the pose of its collider, so "
                f"{placed.name!r} cannot move freely with it: play the scene with a correction of form loads, or bare"
            )
