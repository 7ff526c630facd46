"""Steps of random scenes, in great number: does any of them end in NaN, in an error, or with a collider inside the body
that no status tells of?

    python -m benchmarks.random_scenes examples/jelly3d_small.toml --steps 200000 --processes 2
    python -m benchmarks.random_scenes examples/jelly2d_star_small.toml --steps 800000 --processes 2
    python -m benchmarks.random_scenes examples/jelly_library_small.toml --model ours

Scene k is drawn from the seed and k alone. A shape of the library (in the plane a polygon or star), of 3 to 30 mm, is
thrown at the body with up to 20 m/s (1 to 1000 g; in the plane 0.03 to 30 kg per metre of thickness), led across it up
to 25 mm deep, or thrown while another one is led; with or without linear mechanics (or a correction of the run for any
collider, `--model`), with or without friction, with steps of 1/1000 to 1/30 s. It ends after 100 steps, or ten that are
pierced. In every tenth step the depth of the colliders is found in all cells of the body
(`runtime/contact/intrusion.py`): above the limit of the step's own check by half, in a step that says that it has
converged, it is *silent*.

Needs `softprint body EXPERIMENT`; mechanics are computed where `softprint train` has not left them. Finished scenes are
kept in RUN/random_scenes.jsonl (of a correction in RUN/random_scenes_MODEL.jsonl): a run that was stopped continues,
and a longer one adds to it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import count, islice
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, load_body
from softprint.runtime.body.rotations import rotation_dofs
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import Collider, RigidPose, Sphere
from softprint.runtime.colliders.library import library_collider
from softprint.runtime.colliders.path import KeyframedPath
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.colliders.sampled.polygon import polygon_collider
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    ReducedState,
    Simulator,
    StepResult,
)
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment
from softprint.runtime.io.files import atomic_path
from softprint.runtime.learned.correction import mechanics_of
from softprint.runtime.learned.correction_file import read_correction
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path
from softprint.runtime.rigid import free_collider
from softprint.runtime.shapes import SHAPES

STEPS = 100
CHECKED_EVERY = 10
_GIVEN_UP = 10
# The exact depth may exceed that of the check in every step by the error of the latter, half of its limit.
SILENT = 1.5
CONTACT_NODES = 3000
MECHANICS = "mechanics"
# The inner radius of stars: pointed, blunt, and nearly convex.
_STARS = (0.3, 0.6, 0.9)
# The heaviest that is thrown, kg; in the plane kg per metre of thickness.
_MASS = {2: 30.0, 3: 1.0}


@dataclass
class Counted:
    """What happened in one scene. kind: of scene and model; worst: the deepest that a collider was inside the body in a
    step that says that it has converged [m]; seconds and slowest: of all steps, and of one [s]."""

    scene: int
    kind: str
    steps: int = 0
    pierced: int = 0
    unconverged: int = 0
    not_finite: int = 0
    checked: int = 0
    silent: int = 0
    worst: float = 0.0
    error: str = ""
    first_silent: list[int] = field(default_factory=list)
    seconds: float = 0.0
    slowest: float = 0.0


class Scenes:
    """Random scenes on the body of a run."""

    def __init__(self, experiment: Path, run: Path, seed: int, model: str = MECHANICS) -> None:
        self.experiment, self.seed = load_experiment(experiment), seed
        self.body: ReducedBody = load_body(run / "body.h5")
        stored = mechanics_path(run, CONTACT_NODES)
        self.mechanics: BodyMechanics = (
            load_mechanics(stored, self.body)
            if stored.is_file()
            else compute_mechanics(self.body, CONTACT_NODES, True)
        )
        self.model, self.correction = model, None
        if model != MECHANICS:
            self.correction = read_correction(
                run / "corrections" / f"{model}.safetensors", self.body, self.mechanics
            )
        self.law = PenaltyContact.of(self.experiment.contact)
        self.dim = self.body.dim
        self.top = float(self.body.mesh.points[:, -1].max())
        self.reach = self.body.mesh.points[:, :-1].max(axis=0)

    def play(self, number: int) -> Counted:
        """One scene, to its end or to the first error."""
        rng = np.random.default_rng([self.seed, number])
        thrown, led = [(True, False), (False, True), (True, True)][rng.integers(3)]
        colliders = [*([self._thrown(rng)] if thrown else []), *([self._led(rng)] if led else [])]
        with_mechanics, with_friction = rng.random() < 0.7, rng.random() < 0.5
        mechanics = self.mechanics if with_mechanics else None
        if self.correction is not None and with_mechanics:
            corrections = [self.correction.on(c.collider) for c in colliders]
            colliders = [replace(c, correction=own) for c, own in zip(colliders, corrections, strict=True)]
            mechanics = mechanics_of(corrections, mechanics)
        words = [self.model if with_mechanics else "bare", *[c.name for c in colliders]]
        counted = Counted(number, " ".join(words))
        try:
            simulator = Simulator(
                self.body,
                colliders,
                contact=self.law,
                mechanics=mechanics,
                friction=CoulombFriction(0.4) if with_friction else None,
                gravity=self.experiment.dynamics.gravity,
                kinematic=[KinematicHandle(frame.name) for frame in self.body.handles.frames[:1]],
                settings=DynamicsSettings(
                    float(np.exp(rng.uniform(np.log(1 / 1000), np.log(1 / 30)))),
                    NewtonSettings(max_iterations=40),
                ),
            )
            state = simulator.rest_state()
            for step in range(STEPS):
                began = perf_counter()
                result = simulator.step(state)
                taken = perf_counter() - began
                counted.seconds, counted.slowest = counted.seconds + taken, max(counted.slowest, taken)
                state = result.state
                self._count(counted, simulator, result, step)
                if not _finite(state) or counted.pierced == _GIVEN_UP:
                    break
        except (SoftprintError, ArithmeticError, ValueError, AssertionError, IndexError) as error:
            counted.error = f"{type(error).__name__}: {error}"
        return counted

    def _count(
        self, counted: Counted, simulator: Simulator, result: StepResult[ReducedState], step: int
    ) -> None:
        counted.steps += 1
        counted.pierced += result.piercing is not None
        counted.unconverged += not result.converged and result.piercing is None
        counted.not_finite += not _finite(result.state)
        if step % CHECKED_EVERY or not result.converged:
            return
        counted.checked += 1
        deepest = deepest_inside(simulator, result.state)
        counted.worst = max(counted.worst, deepest)
        if deepest > SILENT * simulator.pierced_from:
            counted.silent += 1
            counted.first_silent = counted.first_silent or [step]

    def _shape(self, rng: np.random.Generator, name: str) -> Collider:
        size = float(rng.choice([0.003, 0.006, 0.012, 0.02, 0.03]))
        if rng.random() < 0.3:
            return Sphere(size, self.dim, name)
        if self.dim == 2:
            return _star(int(rng.integers(3, 9)), float(rng.choice(_STARS)), size, name)
        return _library(str(rng.choice(sorted(SHAPES))), size, name)

    def _turn(self, rng: np.random.Generator) -> Array:
        """A rotation (dim, dim)."""
        if self.dim == 2:
            return rotation_matrix(rng.uniform(-np.pi, np.pi), 2)
        return np.asarray(Rotation.random(random_state=rng).as_matrix())

    def _thrown(self, rng: np.random.Generator) -> PlacedCollider:
        shape = self._shape(rng, "thrown")
        sideways = self.dim - 1
        at = np.append(rng.uniform(-0.6, 0.6, sideways) * self.reach, self.top + 1.8 * shape.size + 0.002)
        pose = RigidPose(self._turn(rng), at)
        direction = np.append(rng.uniform(-0.5, 0.5, sideways), -1.0)
        velocity = direction * np.exp(rng.uniform(np.log(0.1), np.log(20)))
        mass = _MASS[self.dim] * float(np.exp(rng.uniform(np.log(1e-3), np.log(1.0))))
        spin = rng.normal(0.0, 3.0, rotation_dofs(self.dim))
        free = free_collider(shape, pose, mass=mass, velocity=velocity, spin=spin)
        return PlacedCollider("thrown", shape, free=free)

    def _led(self, rng: np.random.Generator) -> PlacedCollider:
        """Down to some depth, across, and up again."""
        shape = self._shape(rng, "led")
        rotation = self._turn(rng)
        low = float((_points(shape) @ rotation.T)[:, -1].min())
        height = self.top - low - np.array([-0.005, *rng.uniform(0.0, 0.025, 3), -0.02])
        across = rng.uniform(-0.8, 0.8, (5, self.dim - 1)) * self.reach
        across[1] = across[0]
        times = np.cumsum([0.0, *np.exp(rng.uniform(np.log(0.02), np.log(0.5), 4))])
        turns = np.tile(RigidPose(rotation, np.zeros(self.dim)).rotation_vector, (5, 1))
        return PlacedCollider(
            "led", shape, path=KeyframedPath(times, np.column_stack([across, height]), turns)
        )


def deepest_inside(simulator: Simulator, state: ReducedState) -> float:
    """How deep a collider is inside the body, by all of its cells as they are drawn [m]; 0 where none is."""
    body, places = simulator.body, [(c.collider, state.poses[c.name]) for c in simulator.colliders]
    touching = [(collider, pose) for collider, pose in places if _is_near(body, collider, pose)]
    if not touching:
        return 0.0
    x = simulator.positions(state)
    found = (intrusion(pose.apply(_points(collider)), body.mesh, x) for collider, pose in touching)
    return max(one.depth for one in found)


def _is_near(body: ReducedBody, collider: Collider, pose: RigidPose) -> bool:
    upper, reach = body.mesh.points.max(axis=0), 2.0 * collider.size
    return bool((np.abs(pose.translation[:-1]) < upper[:-1] + reach).all()) and bool(
        -reach < pose.translation[-1] < upper[-1] + reach
    )


@lru_cache(maxsize=1024)
def _library(entry: str, size: float, name: str) -> Collider:
    return library_collider(entry, size, name=name)


@lru_cache(maxsize=1024)
def _star(spikes: int, inner: float, size: float, name: str) -> Collider:
    """In the plane: tips at `size` [m] from its centre, and corners between them at the share `inner` of that."""
    angles = np.pi / spikes * np.arange(2 * spikes)
    radii = size * np.tile([1.0, inner], spikes)
    outline = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return polygon_collider(outline, 0.02 * size, 192, name)


@lru_cache(maxsize=1024)
def _points(collider: Collider) -> Array:
    return surface_points(collider)


def _finite(state: ReducedState) -> bool:
    return bool(
        np.isfinite(state.rows).all()
        and np.isfinite(state.rows_velocity).all()
        and all(np.isfinite(pose.matrix).all() for pose in state.poses.values())
    )


_scenes: Scenes | None = None


def _begin(experiment: Path, run: Path, seed: int, model: str) -> None:
    global _scenes
    logging.getLogger("softprint").setLevel(logging.ERROR)  # each warning is counted
    _scenes = Scenes(experiment, run, seed, model)


def _play(number: int) -> dict[str, Any]:
    assert _scenes is not None  # made when the process began
    return vars(_scenes.play(number))


def _read(path: Path, made_with: dict[str, Any]) -> list[dict[str, Any]]:
    """The finished scenes; a line that was cut off is not one, and is removed. Raises SoftprintError where they were
    played with something else; a new record begins with what it is made with."""
    if not path.is_file():
        path.write_text(json.dumps(made_with) + "\n")
        return []
    whole = [line for line in path.read_text().splitlines(keepends=True) if line.endswith("}\n")]
    head = json.loads(whole[0]) if whole else None
    if head != made_with:
        raise SoftprintError(
            f"{path}: its scenes were played with {head}, and these would be with {made_with}: remove it to start again"
        )
    with atomic_path(path) as temporary:
        temporary.write_text("".join(whole))
    return [vars(Counted(**json.loads(line))) for line in whole[1:]]


def _table(done: Sequence[dict[str, Any]], reduced: str) -> Iterator[str]:
    heads = [
        "model",
        "scenes",
        "steps",
        "PIERCED",
        "others not converged",
        "not finite",
        "checked in all cells",
    ]
    heads += ["silent", "deepest, mm", "errors", "a step, ms", "slowest, s"]
    yield "| " + " | ".join(heads) + " |"
    yield "| --- " * len(heads) + "|"
    for model in ("bare", reduced):
        mine = [scene for scene in done if scene["kind"].split()[0] == model]
        steps = max(1, sum(scene["steps"] for scene in mine))

        def total(key: str) -> int:
            return sum(scene[key] for scene in mine)  # noqa: B023

        yield (
            f"| {model} | {len(mine)} | {total('steps')} | {total('pierced') / steps:.2%} | "
            f"{total('unconverged') / steps:.2%} | {total('not_finite')} | {total('checked')} | {total('silent')} | "
            f"{1e3 * max((scene['worst'] for scene in mine), default=0.0):.1f} | "
            f"{sum(bool(scene['error']) for scene in mine)} | {1e3 * total('seconds') / steps:.0f} | "
            f"{max((scene['slowest'] for scene in mine), default=0.0):.1f} |"
        )
    for scene in done:
        if scene["error"] or scene["silent"] or scene["not_finite"]:
            yield f"scene {scene['scene']} ({scene['kind']}): {scene['error'] or scene}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Plays what is missing, and prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="the run directory; default: runs/NAME")
    parser.add_argument("--steps", type=int, default=10_000, help="in all, finished ones included")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--model", default=MECHANICS, metavar="NAME", help="a correction in place of mechanics"
    )
    options = parser.parse_args(arguments)
    run = options.out or Path("runs") / options.experiment.stem
    suffix = "" if options.model == MECHANICS else f"_{options.model}"
    record = run / f"random_scenes{suffix}.jsonl"
    text = hashlib.sha256(options.experiment.read_bytes()).hexdigest()
    body = load_body(run / "body.h5").content_hash
    done = _read(record, {"seed": options.seed, "model": options.model, "experiment": text, "body": body})
    finished = {scene["scene"] for scene in done}
    missing = (number for number in count() if number not in finished)
    played = sum(scene["steps"] for scene in done)
    with (
        ProcessPoolExecutor(
            options.processes,
            initializer=_begin,
            initargs=(options.experiment, run, options.seed, options.model),
        ) as pool,
        record.open("a") as file,
        tqdm(
            total=options.steps, initial=min(played, options.steps), unit="step", unit_scale=True
        ) as progress,
    ):
        # A scene may take a hundred times as long as another, and no process waits for it.
        start = options.processes if played < options.steps else 0
        running = {pool.submit(_play, number) for number in islice(missing, start)}
        while running:
            ended, running = wait(running, return_when=FIRST_COMPLETED)
            for scene in (future.result() for future in ended):
                done.append(scene)
                file.write(json.dumps(scene) + "\n")
                file.flush()
                played += scene["steps"]
                progress.update(scene["steps"])
                if played < options.steps:
                    running.add(pool.submit(_play, next(missing)))
    print("\n".join(_table(done, options.model)))


if __name__ == "__main__":
    run_script(main)
