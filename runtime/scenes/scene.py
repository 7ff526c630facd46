"""The parts of a simulator that a scene of an experiment describes, for reduced and full space alike."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders import Collider, KeyframedPath, RigidPose
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics.kinematic import KinematicHandle
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.settings import DynamicsSettings
from softprint.runtime.dynamics.simulator import Simulator
from softprint.runtime.dynamics.terms.springs import HandleSpring
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.recorded_motion import read_recorded_motion
from softprint.runtime.learned.correction import Correction
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.optimise import NewtonSettings
from softprint.runtime.rigid import free_collider

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment, KeyframeSpec, SceneSpec
    from softprint.runtime.experiment.schema.scene import KinematicEntry, SceneColliderSpec


@dataclass(frozen=True, eq=False)
class SceneParts:
    """Colliders without corrections; friction is None if the coefficient is 0."""

    colliders: tuple[PlacedCollider, ...]
    contact: PenaltyContact
    friction: CoulombFriction | None
    gravity: Array
    springs: tuple[HandleSpring, ...]
    kinematic: tuple[KinematicHandle, ...]
    settings: DynamicsSettings

    @property
    def held(self) -> bool:
        """Whether springs or kinematic handles hold the body, so that it has a static equilibrium to start from."""
        return bool(self.kinematic or self.springs)


def find_scene(experiment: Experiment, name: str) -> SceneSpec:
    """The scene of that name; SoftprintError if there is none."""
    for scene in experiment.scenes:
        if scene.name == name:
            return scene
    known = ", ".join(scene.name for scene in experiment.scenes) or "none"
    raise SoftprintError(f"{experiment.path}: there is no scene {name!r}; its scenes: {known}")


def held_frames(experiment: Experiment) -> set[str]:
    """The names of the frames that are held or moved in every scene: nothing is solved for there."""
    held = [
        {str(entry if isinstance(entry, int | str) else entry.handle) for entry in scene.kinematic}
        for scene in experiment.scenes
    ]
    return set.intersection(*held) if held else set()


def scene_steps(experiment: Experiment, scene: SceneSpec) -> int:
    """How many time steps fill the scene's duration; frame 0 comes before them."""
    return max(1, round(scene.duration / experiment.dynamics.time_step))


def scene_parts(experiment: Experiment, scene: SceneSpec) -> SceneParts:
    """Build everything that a scene needs except the body and the model."""
    dynamics, contact = experiment.dynamics, experiment.contact
    return SceneParts(
        colliders=tuple(
            _placed(entry, build_collider(experiment.collider(entry.name), experiment.base_dir))
            for entry in scene.colliders
        ),
        contact=PenaltyContact.of(contact),
        friction=CoulombFriction(contact.friction, contact.slip_velocity) if contact.friction else None,
        gravity=np.array(dynamics.gravity),
        springs=_springs(experiment, scene),
        kinematic=tuple(_kinematic(entry, experiment.dim) for entry in scene.kinematic),
        settings=DynamicsSettings(
            time_step=dynamics.time_step,
            newton=NewtonSettings(max_iterations=dynamics.max_iterations, tolerance=dynamics.tolerance),
        ),
    )


def _springs(experiment: Experiment, scene: SceneSpec) -> tuple[HandleSpring, ...]:
    """The springs that the scene lists, and those that follow its recorded motion."""
    springs = [
        HandleSpring(
            spring.handle,
            spring.stiffness,
            _path(spring.keyframes, experiment.dim)
            if spring.target is None
            else KeyframedPath([0.0], [spring.target]),
            spring.rotation_stiffness,
        )
        for spring in scene.springs
    ]
    if scene.tracking is not None:
        file = experiment.base_dir / scene.tracking.file
        springs += [
            HandleSpring(
                track.frame,
                scene.tracking.stiffness,
                track.path,
                scene.tracking.rotation_stiffness,
                track.anchor,
            )
            for track in read_recorded_motion(file, experiment.dim)
        ]
    return tuple(springs)


def _placed(entry: SceneColliderSpec, collider: Collider) -> PlacedCollider:
    """A collider that follows its keyframes, or moves freely from its start."""
    dim = collider.dim
    if not entry.free:
        return PlacedCollider(entry.name, collider, _path(entry.keyframes, dim))
    still = np.zeros(1 if dim == 2 else 3)
    assert entry.position is not None  # checked in `consistency.py`
    pose = RigidPose.from_rotation_vector(
        still if entry.rotation is None else entry.rotation, np.array(entry.position)
    )
    free = free_collider(
        collider,
        pose,
        density=entry.density,
        mass=entry.mass,
        velocity=entry.velocity,
        spin=None if entry.spin is None else np.atleast_1d(entry.spin),
    )
    return PlacedCollider(entry.name, collider, free=free)


def _kinematic(entry: KinematicEntry, dim: int) -> KinematicHandle:
    """A handle that is fixed, if only its name or number is given, or follows its keyframes."""
    if isinstance(entry, int | str):
        return KinematicHandle(entry)
    return KinematicHandle(entry.handle, _path(entry.keyframes, dim))


def _path(keyframes: Iterable[KeyframeSpec] | None, dim: int) -> KeyframedPath:
    frames = tuple(keyframes or ())
    none = np.zeros(1 if dim == 2 else 3)
    rotations = [none if frame.rotation is None else np.atleast_1d(frame.rotation) for frame in frames]
    return KeyframedPath(
        [frame.time for frame in frames], [frame.position for frame in frames], np.array(rotations)
    )


def scene_simulator(
    body: ReducedBody,
    parts: SceneParts,
    corrections: Iterable[Correction] = (),
    mechanics: BodyMechanics | None = None,
    internal: InternalField | None = None,
) -> Simulator:
    """The reduced simulator of a scene: the bare subspace, or with one correction for a collider, and the mechanics
    and an internal correction of the body."""
    by_collider = {correction.collider: correction for correction in corrections}
    colliders = tuple(replace(placed, correction=by_collider.get(placed.name)) for placed in parts.colliders)
    return Simulator(
        body,
        colliders,
        contact=parts.contact,
        mechanics=mechanics,
        internal=internal,
        friction=parts.friction,
        gravity=parts.gravity,
        springs=parts.springs,
        kinematic=parts.kinematic,
        settings=parts.settings,
    )
