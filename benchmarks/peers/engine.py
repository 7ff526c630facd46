"""What a simulator has to offer to be compared, and how it is played and timed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

import numpy as np

from benchmarks.peers.scene import FRAME, Scene
from softprint.runtime.arrays import Array
from softprint.runtime.errors import SoftprintError

# Frames in which a simulator settles under gravity, with the velocities set to zero after each, and untimed.
SETTLED = 10
_LOST = 1.0  # of the size of the body: a node that has moved farther is lost


class MissingEngine(SoftprintError):
    """An optional dependency is not installed."""


class Engine(Protocol):
    """A simulator with one body and one collider of a scene."""

    def settle(self, x: Array) -> None:
        """Come to rest under gravity, with the collider at its first pose; x: (n_nodes, 3) full space at rest [m]."""

    def advance(self, begin: float, end: float) -> None:
        """Simulate from one time to another [s], with the collider led along its path."""

    def positions(self) -> Array:
        """(n_nodes, 3) [m]."""

    def force(self) -> Array:
        """(3,) of the body on the collider [N], in the last step."""


@dataclass(frozen=True)
class Setting:
    """One row: an engine with its settings. engine: name of the row and curve; law: of elasticity; note: what is set
    besides; step: [s]; iterations: of a step, 0 where the solver stops by its own tolerance."""

    engine: str
    law: str
    note: str
    step: float
    iterations: int
    make: Callable[[Scene], Engine]


@dataclass(frozen=True, eq=False)
class Played:
    """Frames of one scene. x: (t, n_nodes, 3) [m]; force: (t, 3) [N]; depth: of the body's surface in the collider (t,)
    [m]; cpu, wall: seconds of `simulated` seconds; ended: why it stopped early, empty if it did not."""

    x: Array
    force: Array
    depth: Array
    cpu: float
    wall: float
    simulated: float
    ended: str


def play(engine: Engine, scene: Scene, rest: Array, frames: int | None = None) -> Played:
    """One scene from rest; frames: of it, by default all. What is timed is the motion, with the
    positions of all nodes at every frame, and not settling and measuring."""
    engine.settle(rest)
    x, force, depth = [], [], []
    cpu = wall = 0.0
    ended = ""
    for frame in range(scene.n_frames if frames is None else frames):
        end = (frame + 1) * FRAME
        cpu_began, wall_began = time.process_time(), time.perf_counter()
        engine.advance(frame * FRAME, end)
        now = engine.positions()
        cpu += time.process_time() - cpu_began
        wall += time.perf_counter() - wall_began
        moved = np.abs(now - scene.body.mesh.points).max()
        if not moved < _LOST * scene.body.mesh.size:  # NaN is lost too
            ended = f"unstable at {end:.2f} s"
            break
        x.append(now)
        force.append(engine.force())
        depth.append(scene.depth(now, end))
    shape = (-1, scene.body.n_nodes, 3)
    return Played(np.reshape(x, shape), np.reshape(force, (-1, 3)), np.array(depth), cpu, wall, end, ended)


def relax(engine: Engine, place: Callable[[Array], None], x: Array, frames: int = SETTLED) -> None:
    """Let a simulator come to rest from x (n_nodes, 3). place: puts nodes somewhere, at rest."""
    place(x)
    for _ in range(frames):
        engine.advance(0.0, 0.0)
        place(engine.positions())


def steps_of(step: float) -> int:
    """How many steps a frame has. Raises SoftprintError where they do not fill it."""
    count = round(FRAME / step)
    if count < 1 or abs(count * step / FRAME - 1.0) > 1e-6:
        raise SoftprintError(f"a frame of {FRAME:.6g} s is no whole number of steps of {step:.6g} s")
    return count


def engine_module(module: str, packages: str) -> Any:
    """An optional dependency. Raises MissingEngine, with the packages that bring it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingEngine(
            f"{module} is not installed ({error}): python -m pip install --no-deps {packages}"
        ) from error
