"""What a user may ask of a session. All of it is plain data, so that it can go to another process.

Positions are metres in the world; a rotation is a matrix (dim, dim). Numbers from outside are checked where they
are used (`Session.handle`): a bad one is answered with a sentence.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.kinds.table import ColliderTable


@dataclass(frozen=True, eq=False)
class LeadCollider:
    """Move a collider to a pose. A free one is held while it is led (`DropCollider` lets go)."""

    name: str
    position: Array
    rotation: Array | None = None


@dataclass(frozen=True)
class DropCollider:
    """Let a collider move freely, with a density [kg/m^3], or hold it where it is (None)."""

    name: str
    density: float | None


@dataclass(frozen=True)
class SetShapes:
    """Put other colliders in the scene: their tables; those whose names are kept stay where they are."""

    tables: tuple[ColliderTable, ...]


@dataclass(frozen=True, eq=False)
class GrabBody:
    """Pull the point of the body nearest to `point` (dim,), as drawn by the first model, by a spring."""

    point: Array
    stiffness: float | None = None


@dataclass(frozen=True, eq=False)
class PullBody:
    """Move the end of the spring."""

    target: Array


@dataclass(frozen=True)
class LetGo:
    """Take the spring off the body."""


@dataclass(frozen=True, eq=False)
class LeadHandle:
    """Displace a handle from rest (dim,) [m], and rotate a frame about its pivot; None gives it back to the scene."""

    handle: int | str
    displacement: Array | None
    rotation: Array | None = None


@dataclass(frozen=True)
class SetModels:
    """The models that play: one, or two side by side."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class SetColour:
    """The values that the body is coloured by: one of `painting.QUANTITIES`."""

    quantity: str


@dataclass(frozen=True)
class SetPace:
    """paused; speed: of time, 1 is real time; iterations: of Newton a step at most, None as the experiment says."""

    paused: bool = False
    speed: float = 1.0
    iterations: int | None = None


@dataclass(frozen=True)
class StepOnce:
    """One step, while paused."""


@dataclass(frozen=True)
class Reset:
    """Back to the start: the body at rest, every collider where the scene has it."""


@dataclass(frozen=True)
class Record:
    """Begin to record (`on`), or end it and write the files; film: with a GIF of each motion."""

    on: bool
    film: bool = False


@dataclass(frozen=True)
class Tell:
    """Say again what the session is made of, for a window that has come later."""


@dataclass(frozen=True)
class Quit:
    """End the session; a recording in progress is written."""


Command = (
    LeadCollider
    | DropCollider
    | SetShapes
    | GrabBody
    | PullBody
    | LetGo
    | LeadHandle
    | SetModels
    | SetColour
    | SetPace
    | StepOnce
    | Reset
    | Record
    | Tell
    | Quit
)


@dataclass(frozen=True)
class Notice:
    """A sentence for the user. kind: "info", "good" or "bad"."""

    text: str
    kind: str = "info"


@dataclass(frozen=True)
class Setting:
    """What the session is made of now, for the panel. models: that play; colliders: their tables; free: names of those
    that move freely; recording: seconds, None if there is no recording; building: what is being made, empty if
    nothing."""

    models: tuple[str, ...]
    tables: tuple[ColliderTable, ...]
    free: tuple[str, ...] = ()
    recording: float | None = None
    building: str = ""
    led: tuple[int | str, ...] = field(default=())


Event = Notice | Setting
