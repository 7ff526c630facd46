"""What the tolerance of a step costs, and how far it moves a motion.

    python -m benchmarks.step_tolerance EXPERIMENT.toml SCENE [--out RUN] [--model ours] [--tolerances 1e-4 1e-3 1e-2]
        [--tight 1e-6] [--stand-in]

One motion, played by a model to every tolerance (`dynamics.tolerance`) and to a tight one, one after the other. Over
the frames in contact: CPU time and Newton iterations of a step, mean and 95th percentile; the distance of all nodes
from the tight motion, and of the forces on the colliders (RMS, and that of the worst frame); steps that converged.
Where full space has played the scene (RUN/motions), how far the model itself is from it stands below: a tolerance need
not be finer than that. --stand-in: an untrained network, as in `benchmarks.bodies_speed`, where none is trained.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.bodies_speed import correction_file
from benchmarks.motions_alone import rms
from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment
from softprint.runtime.experiment.schema.scene import SceneSpec
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.playing import SceneModel, build_model, model_of_file
from softprint.runtime.scenes.scene import find_scene, scene_steps
from softprint.runtime.scenes.speed import machine, with_newton

# As many iterations as any step of the tight motion may need.
_MOST = 100
HEADS = "tolerance", "mean ms", "95 %", "iterations", "mm from the tight: RMS, worst", "N: RMS, worst", "converged"


class Played(NamedTuple):
    """n steps. position: (n, n_nodes, dim) [m]; force: (n, colliders, dim) [N]; seconds: (n,) of CPU time; iterations,
    converged, in_contact: (n,)."""

    position: Array
    force: Array
    seconds: Array
    iterations: Array
    converged: BoolArray
    in_contact: BoolArray


def made(
    experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path, name: str, stand_in: Path | None
) -> SceneModel:
    """A model of the run directory, or of a stand-in's file."""
    if stand_in is not None:
        return model_of_file(experiment, body, scene, stand_in)
    return build_model(experiment, body, scene, out, name)


def played(model: SceneModel, n_steps: int) -> Played:
    """Plays a scene; compiled kernels are loaded before the first step that is timed."""
    state = model.start().state
    model.step(state)
    rows = []
    for _ in range(n_steps):
        began = time.process_time()
        result = model.step(state)
        seconds, state = time.process_time() - began, result.state
        forces = np.array([contact.force for contact in result.contacts.values()])
        position = np.asarray(model.positions(state), dtype=np.float32)
        rows.append((position, forces, seconds, result.iterations, result.converged, result.in_contact))
    return Played(*(np.array(column) for column in zip(*rows, strict=True)))


def line(name: str, own: Played, tight: Played) -> str:
    """A line of the table; the frames are those in which the tight motion is in contact."""
    of = np.flatnonzero(tight.in_contact)
    ms, force = 1e3 * own.seconds[of], own.force[of] - tight.force[of]
    off = own.position[of] - tight.position[of]
    worst = max(rms(frame) for frame in off)
    cells = [
        name,
        f"{ms.mean():.1f}",
        f"{np.quantile(ms, 0.95):.1f}",
        f"{own.iterations[of].mean():.2f}",
        f"{1e3 * rms(off):.4f}, {1e3 * worst:.4f}",
        f"{rms(force):.4f}, {np.linalg.norm(force, axis=-1).max():.4f} of {rms(tight.force[of]):.2f}",
        f"{own.converged[of].mean():.1%}",
    ]
    return f"| {' | '.join(cells)} |"


def from_full_space(path: Path, tight: Played) -> str:
    """How far the tight motion is from full space."""
    full = load_motion(path)
    frames = np.flatnonzero(full.in_contact)
    frames = frames[frames > 0]
    off = np.array([rms(tight.position[k - 1] - full.positions(int(k))) for k in frames])
    force = np.stack([track.force[frames] for track in full.colliders.values()], axis=1)
    return (
        f"The model itself is {1e3 * np.sqrt(np.mean(off**2)):.3f} mm and "
        f"{rms(tight.force[frames - 1] - force):.3f} N (RMS) from full space."
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml")
    parser.add_argument("scene", metavar="SCENE")
    parser.add_argument("--out", type=Path, default=None, metavar="RUN", help="run directory")
    parser.add_argument("--model", default="ours")
    parser.add_argument("--tolerances", type=float, nargs="+", default=[1e-4, 1e-3, 1e-2])
    parser.add_argument("--tight", type=float, default=1e-6)
    parser.add_argument("--stand-in", action="store_true", help="with an untrained network")
    options = parser.parse_args(arguments)
    context = Context(options.experiment, out=options.out)
    body, scene = body_of_run(context), find_scene(context.experiment, options.scene)
    stand_in = correction_file(context, body, None)[0] if options.stand_in else None

    def to(tolerance: float) -> Played:
        experiment = with_newton(context.experiment, _MOST, tolerance)
        model = made(experiment, body, scene, context.out_dir, options.model, stand_in)
        return played(model, scene_steps(experiment, scene))

    tight = to(options.tight)
    if not tight.in_contact.any():
        raise SoftprintError(f"{options.experiment}: scene {scene.name!r}: nothing is touched in it")
    print(f"{machine()['processor']}, scene {scene.name}, {options.model}")
    print(f"| {' | '.join(HEADS)} |")
    print("| --- " * len(HEADS) + "|")
    print(line(f"{options.tight:.0e}", tight, tight), flush=True)
    for tolerance in options.tolerances:
        print(line(f"{tolerance:.0e}", to(tolerance), tight), flush=True)
    full = context.out_dir / "motions" / f"{scene.name}_full.h5"
    if full.is_file():
        print(from_full_space(full, tight))


if __name__ == "__main__":
    run_script(main)
