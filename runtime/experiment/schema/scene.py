"""The `[[scenes]]` tables: scripted motions, for recording states or comparing models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from softprint.runtime.experiment.schema.section import Name, NotNegative, Positive, Section, Vector

Rotation = Annotated[tuple[float, ...], Field(min_length=1, max_length=3)]


class KeyframeSpec(Section):
    """A pose at one time; motion between keyframes is smooth."""

    time: NotNegative = Field(description="[s]")
    position: Vector = Field(description="[m]")
    rotation: float | Rotation | None = Field(None, description="angle in 2D, axis times angle in 3D [rad]")


Keyframes = Annotated[tuple[KeyframeSpec, ...], Field(min_length=1)]


class SceneColliderSpec(Section):
    """A collider in a scene: moved along `keyframes`, or, with a density or a mass, free to move."""

    name: str = Field(description="one of [[colliders]], or a library shape if there is a [library]")
    keyframes: Keyframes | None = Field(None, description="poses over time, times increasing")
    density: Positive | None = Field(
        None, description="moves freely, with this density [kg/m^3] (kg/m^2 in 2D)"
    )
    mass: Positive | None = Field(None, description="moves freely, with this mass [kg]")
    position: Vector | None = Field(None, description="start position of a free collider [m]")
    rotation: float | Rotation | None = Field(
        None, description="start rotation of a free collider: angle in 2D, axis times angle in 3D [rad]"
    )
    velocity: Vector | None = Field(None, description="velocity of its centre of mass at the start [m/s]")
    spin: float | Rotation | None = Field(
        None, description="angular velocity at the start: one number in 2D, three in 3D [rad/s]"
    )

    @property
    def free(self) -> bool:
        """Whether it moves freely under forces."""
        return self.density is not None or self.mass is not None


class KinematicSpec(Section):
    """A handle that follows keyframes and is not solved for."""

    handle: int | str = Field(description="number of a point handle or name of a frame")
    keyframes: Keyframes = Field(
        description="motion from rest: displacement of the point or of the frame's pivot, the mean of its "
        "nodes, and rotation of the frame about the pivot"
    )


def _fixed_or_moved(entry: object) -> str:
    return "led" if isinstance(entry, dict | KinematicSpec) else "held"


# Discriminated by kind, so that an error in a table is not reported as a bad name.
KinematicEntry = Annotated[
    Annotated[int | str, Tag("held")] | Annotated[KinematicSpec, Tag("led")], Discriminator(_fixed_or_moved)
]


class SpringSpec(Section):
    """A spring that pulls a handle to a target, fixed (`target`) or moving (`keyframes`)."""

    handle: int | str = Field(description="number of a point handle or name of a frame")
    stiffness: Positive = Field(description="[N/m]")
    rotation_stiffness: NotNegative = Field(
        0.0, description="frames: stiffness towards the rotation of the keyframes, or of rest [N m/rad]"
    )
    target: Vector | None = Field(None, description="target position [m]")
    keyframes: Keyframes | None = Field(None, description="target pose over time")


class TrackingSpec(Section):
    """Springs by which frames, such as the bones of a hand, follow a recorded motion."""

    file: Path = Field(
        description="table of frames, times and poses (CSV, see runtime/experiment/recorded_motion.py), relative to "
        "the experiment file"
    )
    stiffness: Positive = Field(description="stiffness of each frame's spring [N/m]")
    rotation_stiffness: Positive = Field(description="rotational stiffness of each frame's spring [N m/rad]")


class SceneSpec(Section):
    """`[[scenes]]`: one motion of the body, its colliders and its handles."""

    name: Name = Field(description="file name of its motions")
    role: Literal["record", "test"] = Field(
        description="record: a source of states for sampling; test: held out, to compare models"
    )
    duration: Positive = Field(le=1e4, description="[s]")
    kinematic: tuple[KinematicEntry, ...] = Field(
        (), description="handles that are fixed, by name or number, or moved along keyframes, as tables"
    )
    colliders: tuple[SceneColliderSpec, ...] = ()
    springs: tuple[SpringSpec, ...] = ()
    tracking: TrackingSpec | None = None

    @property
    def leads_points(self) -> bool:
        """Whether any point handle is held or pulled."""
        pulled = [spring.handle for spring in self.springs]
        return any(isinstance(handle, int) for handle in [*self.kinematic_handles, *pulled])

    @property
    def kinematic_handles(self) -> list[int | str]:
        """The numbers of points and names of frames whose positions are prescribed."""
        return [entry.handle if isinstance(entry, KinematicSpec) else entry for entry in self.kinematic]
