"""The colliders of a scene: moved along paths, posed by the caller, or moving freely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.path import KeyframedPath
from softprint.runtime.colliders.pose import Poses, RigidPose
from softprint.runtime.colliders.shape_samples import is_same_shape, shape_samples
from softprint.runtime.colliders.size_check import check_size
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.dynamics.body_checks import check_kind
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.correction import ContactCorrection, Correction
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.rigid.flight import RigidMotion
from softprint.runtime.rigid.free_collider import FreeCollider


@dataclass(frozen=True, eq=False)
class PlacedCollider:
    """A collider in the scene. path: its pose over time, None where the caller gives its pose with every step;
    correction: learned for its contact with this body; free: mass and initial motion of a collider that moves freely,
    under the forces on it."""

    name: str
    collider: Collider
    path: KeyframedPath | None = None
    correction: Correction | None = None
    free: FreeCollider | None = None


def free_colliders(colliders: Sequence[PlacedCollider]) -> dict[str, FreeCollider]:
    """The colliders that move freely, by name."""
    return {placed.name: placed.free for placed in colliders if placed.free is not None}


def starting_motions(colliders: Sequence[PlacedCollider]) -> dict[str, RigidMotion]:
    """The initial motions of the free colliders."""
    return {name: free.motion for name, free in free_colliders(colliders).items()}


def poses_at(
    colliders: Sequence[PlacedCollider], time: float, poses: Mapping[str, RigidPose] | None
) -> Poses:
    """The pose of every collider at ``time`` [s]: the given one, otherwise that of its path, or the initial one of a
    free collider."""
    if not np.isfinite(time):
        raise SoftprintError(f"the time is {time}: it must be a finite number of seconds")
    given, placed = dict(poses or {}), {}
    unknown = sorted(given.keys() - {collider.name for collider in colliders})
    if unknown:
        raise SoftprintError(f"a pose was given for {', '.join(unknown)}, which is no collider of this scene")
    for collider in colliders:
        if collider.name in given:
            placed[collider.name] = _checked(given[collider.name], collider)
        elif collider.free is not None:
            placed[collider.name] = collider.free.pose
        elif collider.path is not None:
            placed[collider.name] = collider.path.pose(time)
        else:
            raise SoftprintError(f"collider {collider.name!r} has no path: give its pose with every step")
    return placed


def _checked(pose: object, collider: PlacedCollider) -> RigidPose:
    """A given pose. Raises SoftprintError for one of another kind or dimension."""
    check_kind(f"the pose of collider {collider.name!r}", pose, RigidPose)
    assert isinstance(pose, RigidPose)
    if pose.translation.size != collider.collider.dim:
        raise SoftprintError(
            f"the pose of collider {collider.name!r} is {pose.translation.size}D, and the collider is "
            f"{collider.collider.dim}D"
        )
    return pose


def poses_after(
    colliders: Sequence[PlacedCollider], time: float, poses: Mapping[str, RigidPose] | None, before: Poses
) -> Poses:
    """The pose of every collider at the end of a step, at ``time`` [s]; free colliders keep their poses, which the step
    solves for."""
    free = free_colliders(colliders)
    posed = [name for name in free if name in (poses or {})]
    if posed:
        raise SoftprintError(
            f"collider {posed[0]!r} moves freely: leave its pose to the step, or place it without a density and a mass"
        )
    return poses_at(colliders, time, {**(poses or {}), **{name: before[name] for name in free}})


def check_colliders(
    colliders: Sequence[PlacedCollider],
    body: ReducedBody,
    mechanics: BodyMechanics | None,
    contact: PenaltyContact,
) -> None:
    """Raises SoftprintError where names, dimensions, sizes or corrections do not fit together."""
    for placed in colliders:
        check_kind("a collider", placed, PlacedCollider)
    dim, of_contact = body.dim, list[ContactCorrection]()
    names = [placed.name for placed in colliders]
    if len(set(names)) != len(names):
        raise SoftprintError(
            f"two colliders of the scene have the same name; the names are {', '.join(names)}"
        )
    for placed in colliders:
        if placed.collider.dim != dim or (placed.path is not None and placed.path.dim != dim):
            raise SoftprintError(f"collider {placed.name!r} and its path must be {dim}D, as the body is")
        check_size(placed.collider, body.mesh.size)
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
        if isinstance(correction, ContactCorrection):
            _check_contact_correction(placed, correction, mechanics, contact)
            of_contact.append(correction)
        elif placed.free is not None:
            raise SoftprintError(
                f"correction {correction.name!r} has no derivative by the pose of its collider, so {placed.name!r} "
                "cannot move freely with it: play the scene with a correction of form force, or without corrections"
            )
    _check_same_energy(of_contact)


def _check_same_energy(corrections: Sequence[ContactCorrection]) -> None:
    """Raises SoftprintError where corrections have learned different energies of contact."""
    energies = [() if own.learned is None else own.learned.values for own in corrections]
    for other, energy in zip(corrections, energies, strict=True):
        if energy != energies[0]:
            raise SoftprintError(
                f"corrections {corrections[0].name!r} and {other.name!r} have learned different energies of "
                "contact with the body, which all colliders share: give them all corrections of one training"
            )


def _check_contact_correction(
    placed: PlacedCollider,
    correction: ContactCorrection,
    mechanics: BodyMechanics | None,
    contact: PenaltyContact,
) -> None:
    """Raises SoftprintError where its shape is not that of the collider, or its mechanics or contact law are not those
    of the simulator."""
    if placed.collider is not correction.shape and not is_same_shape(
        placed.collider, shape_samples(correction.shape)
    ):
        raise SoftprintError(
            f"correction {correction.name!r} was made for a collider {placed.collider.name!r} of another shape or size "
            "than the one that is placed: make it for this one (`load_correction`, or `on` of a loaded one)"
        )
    own = correction.mechanics.compliance
    given = None if mechanics is None else mechanics.compliance
    if own is None or given is None or not own.equals(given) or not _settle_alike(correction.mechanics, mechanics):
        raise SoftprintError(
            f"correction {correction.name!r} of collider {placed.name!r} corrects forces of the body's mechanics: give "
            "Simulator(mechanics=...) those that it was trained with, `correction.mechanics`"
        )
    law = correction.law
    if not np.isclose(law.stiffness, contact.stiffness, rtol=1e-9):
        raise SoftprintError(
            f"correction {correction.name!r} was trained for a contact stiffness of {law.stiffness:g} N/m^4, "
            f"not for {contact.stiffness:g}: give PenaltyContact({law.stiffness:g}), or train it for this one"
        )
    # Of full space only the distance between points on sharp edges matters here.
    if _points(law) != _points(contact):
        raise SoftprintError(
            f"correction {correction.name!r} was trained for contact {_points(law)}, not {_points(contact)}: give "
            f"contact={law}, or train it for this"
        )


def _settle_alike(own: BodyMechanics, given: BodyMechanics | None) -> bool:
    """Whether the mechanics given have what those of a correction have learned of bent joints."""
    learned = None if own.condensation is None else own.condensation.settling
    if learned is None:
        return True
    there = None if given is None or given.condensation is None else given.condensation.settling
    return there is not None and np.array_equal(there.weights, learned.weights)


def _points(law: PenaltyContact) -> str:
    """Where a law has contact in reduced models."""
    if not law.refinement:
        return "at nodes"
    along = law.reduced_refinement
    where = "the middle and the corners" if along == 1 else f"{along} points along an edge"
    return f"at {where} of every facet, and at tips and edges with refinement {law.refinement}"
