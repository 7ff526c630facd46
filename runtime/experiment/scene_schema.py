"""The `[[scenes]]` tables: scripted motions, to record states from or to compare models on."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from runtime.experiment.section import Name, NotNegative, Positive, Section, Vector

Rotation = Annotated[tuple[float, ...], Field(min_length=1, max_length=3)]


class KeyframeSpec(Section):
    """Where something is at one time; between keyframes it moves smoothly."""

    time: NotNegative = Field(description="[s]")
    position: Vector = Field(description="[m]")
    rotation: float | Rotation | None = Field(None, description="angle in 2D, axis times angle in 3D [rad]")


Keyframes = Annotated[tuple[KeyframeSpec, ...], Field(min_length=1)]


class SceneColliderSpec(Section):
    """A collider on its way through a scene."""

    name: str = Field(description="one of [[colliders]]")
    keyframes: Keyframes = Field(description="poses over time, times increasing")


class SpringSpec(Section):
    """A spring that pulls a handle to a place, fixed (`target`) or moving (`keyframes`)."""

    handle: int | str = Field(description="number of a point handle or name of a frame")
    stiffness: Positive = Field(description="[N/m]")
    target: Vector | None = Field(None, description="where it pulls to [m]")
    keyframes: Keyframes | None = Field(None, description="where it pulls to, over time")


class SceneSpec(Section):
    """`[[scenes]]`: one motion of the body, its colliders and its handles."""

    name: Name = Field(description="file name of its motions")
    role: Literal["record", "test"] = Field(
        description="record: states for sampling come from it; test: held out, models are compared on it"
    )
    duration: Positive = Field(description="[s]")
    kinematic: tuple[str, ...] = Field((), description="frames that are held in place")
    colliders: tuple[SceneColliderSpec, ...] = ()
    springs: tuple[SpringSpec, ...] = ()
