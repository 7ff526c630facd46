"""How free rigid bodies move in reduced models, compared with full space.

    python -m benchmarks.free_bodies examples/falling3d_small.toml examples/cube_small.toml [--set KEY=VALUE]

Plays the first test scene of each experiment in full space and with the reduced model alone, with linear mechanics, and
with `ours` where the run directory has it and no key is set. Over all frames: RMS distance of the nodes of the body
from full space; RMS distance of the free colliders' origins in the first 0.1 s after a free collider first touches the
body, in all frames, and at the end; the largest force of the body on a free collider; Newton iterations; the steps that
failed to converge, and those that ended as PIERCED; milliseconds of processor time of a step. `full space, beside` is
full space once more with the free colliders 10 um aside at the start: how far two motions can be apart that no model
could tell from each other. `25 updates`: of the normal forces of friction in a step, in place of 3.

Needs `softprint body EXPERIMENT`; mechanics are computed where `softprint train` has not left them.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softprint.fem_truth.dynamics.full_space_model import FullSpaceModel, full_space_model
from softprint.fem_truth.dynamics.full_space_model import scene_simulator as full_scene_simulator
from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.body import ReducedBody, load_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import RigidPose
from softprint.runtime.dynamics import PlacedCollider
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path
from softprint.runtime.scenes.playing import (
    ReducedModel,
    SceneModel,
    bare_model,
    correction_path,
    model_of_file,
)
from softprint.runtime.scenes.scene import scene_parts, scene_simulator, scene_steps

CONTACT_NODES = 3000
LANDED = 0.1  # s
ASIDE = 1e-5  # m
UPDATES = 25
OURS = "ours"


@dataclass(frozen=True, eq=False)
class Played:
    """Over F frames: positions (F, n, dim) [m] of the nodes; colliders (F, m, dim) [m], origins of the free ones; force
    (F, m) [N] of the body on each; touching (F,), whether any of them has contact with the body; of the steps:
    iterations, whether they converged, whether they ended as PIERCED, and processor time [s] (F - 1,)."""

    positions: Array
    colliders: Array
    force: Array
    iterations: Array
    converged: BoolArray
    pierced: BoolArray
    seconds: Array


def played(model: SceneModel, steps: int) -> Played:
    """A scene with one model."""
    free = [placed.name for placed in model.colliders if placed.free is not None]
    result, seconds, results = model.start(), list[float](), list[Any]()
    positions, colliders, forces = list[Array](), list[Array](), list[list[float]]()
    for step in range(steps + 1):
        if step:
            began = time.process_time()
            result = model.step(result.state)
            seconds.append(time.process_time() - began)
            results.append(result)
        positions.append(model.positions(result.state))
        colliders.append(np.array([result.state.poses[name].translation for name in free]))
        forces.append([float(np.linalg.norm(result.contacts[name].force)) for name in free])
    return Played(
        np.array(positions),
        np.array(colliders),
        np.array(forces),
        np.array([found.iterations for found in results]),
        np.array([found.converged for found in results]),
        np.array([found.piercing is not None for found in results]),
        np.array(seconds),
    )


def rms(vectors: Array) -> float:
    """sqrt(mean |v|^2) of vectors (..., dim), in millimetres."""
    return 1e3 * float(np.sqrt(np.square(vectors).sum(axis=-1).mean()))


def row(name: str, own: Played, full: Played, landed: slice) -> str:
    """One line of the table; landed: the frames after the first contact."""
    apart = own.colliders - full.colliders
    cells = [
        name,
        f"{rms(own.positions - full.positions):.2f}",
        f"{rms(apart[landed]):.2f}, {rms(apart):.2f}, {rms(apart[-1]):.2f}",
        f"{own.force.max():.2f}",
        f"{own.iterations.mean():.1f}",
        f"{int((~own.converged & ~own.pierced).sum())}, {int(own.pierced.sum())} of {len(own.converged)}",
        f"{1e3 * own.seconds.mean():.0f} ({1e3 * np.percentile(own.seconds, 95):.0f})",
    ]
    return "| " + " | ".join(cells) + " |"


def beside(placed: PlacedCollider) -> PlacedCollider:
    """The same collider, started a little aside if it moves freely."""
    if placed.free is None:
        return placed
    pose = placed.free.pose
    shifted = RigidPose.known(pose.rotation, pose.translation + ASIDE)
    return replace(placed, free=replace(placed.free, pose=shifted))


def models(
    experiment: Experiment, body: ReducedBody, mechanics: BodyMechanics, run: Path, changed: bool
) -> dict[str, SceneModel]:
    """Of the first test scene, full space first. changed: keys, so that trained corrections may not apply."""
    scene = experiment.scenes_of_role("test")[0]
    parts = scene_parts(experiment, scene)
    found: dict[str, SceneModel] = {
        "full space": full_space_model(experiment, body, scene, run),
        "full space, beside": FullSpaceModel(
            full_scene_simulator(replace(parts, colliders=tuple(map(beside, parts.colliders))), body),
            parts.held,
        ),
        "bare": bare_model(experiment, body, scene),
        "mechanics": ReducedModel(scene_simulator(body, parts, mechanics=mechanics), parts.held),
    }
    often = replace(parts, settings=replace(parts.settings, friction_updates=UPDATES))
    for name, own in (("bare", None), ("mechanics", mechanics)):
        simulator = scene_simulator(body, often, mechanics=own)
        found[f"{name}, {UPDATES} updates"] = ReducedModel(simulator, parts.held)
    trained = correction_path(run, OURS)
    if trained.is_file() and not changed:
        found[OURS] = model_of_file(experiment, body, scene, trained)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown for each scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiments", type=Path, nargs="+", metavar="EXPERIMENT")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args(arguments)
    logging.getLogger("softprint").setLevel(logging.ERROR)
    heads = (
        "model",
        "body, mm off",
        "colliders, mm off: landing, all, end",
        "largest force, N",
        "Newton",
        "steps that failed, PIERCED",
        "CPU ms a step (95 %)",
    )
    for path in options.experiments:
        run = Path("runs") / path.stem
        experiment, body = load_experiment(path, options.set), load_body(run / "body.h5")
        stored = mechanics_path(run, CONTACT_NODES)
        mechanics = (
            load_mechanics(stored, body) if stored.is_file() else compute_mechanics(body, CONTACT_NODES, True)
        )
        scene = experiment.scenes_of_role("test")[0]
        print(f"\n{experiment.name}, scene {scene.name}\n")
        print("| " + " | ".join(heads) + " |\n" + "| --- " * len(heads) + "|")
        steps, full, landed = scene_steps(experiment, scene), None, slice(None)
        for name, model in models(experiment, body, mechanics, run, bool(options.set)).items():
            own = played(model, steps)
            if full is None:
                full = own
                first = int(np.flatnonzero(own.force.any(axis=1))[0])
                landed = slice(first, first + round(LANDED / experiment.dynamics.time_step) + 1)
            print(row(name, own, full, landed), flush=True)


if __name__ == "__main__":
    run_script(main)
