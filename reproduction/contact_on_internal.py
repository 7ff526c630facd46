"""How near do motions come to full space where contact acts on a body with an internal correction of another run?

    softprint run      examples/ball_small.toml
    softprint generate examples/ball_alone_small.toml
    softprint train    examples/ball_alone_small.toml
    python -m reproduction.contact_on_internal examples/ball_small.toml \\
        --internal runs/ball_alone_small/internal/modes.safetensors [--out RUN] [--models mechanics ours]

Plays the first test scene with corrections of form force of the run, as they are and with the internal correction in
place of static condensation, which is learned from states without contact. Needs the motion in full space. In Markdown:

    mm            sqrt(mean |x - x_full|^2) over the nodes and over the frames where full space is in contact
    force, N      sqrt(mean |f - f_full|^2) of the force on every collider, of what |f_full| is
    Newton        iterations of all steps, and the share of these that converge
    step          the median of the steps in contact, relative to that of the model as it is
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.motions_alone import rms
from softprint.runtime.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, SceneSpec
from softprint.runtime.learned.correction_file import read_correction
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.scenes.corrected_body import corrected_body
from softprint.runtime.scenes.motion_file import Motion, load_motion
from softprint.runtime.scenes.playing import ReducedModel, corrected_model, correction_path
from softprint.runtime.scenes.scene import scene_parts, scene_simulator
from softprint.runtime.scenes.simulate import motion_path


def on_internal(
    experiment: Experiment, body: ReducedBody, scene: SceneSpec, correction: Path, internal: Path
) -> ReducedModel:
    """The scene with a correction of contact, on an internal correction in place of its static condensation."""
    parts = scene_parts(experiment, scene)
    own, trained = corrected_body(body, internal, parts.gravity), read_correction(correction, body)
    corrections, mechanics = [], own.mechanics
    for placed in filter(lambda placed: trained.is_for(placed.collider), parts.colliders):
        found = trained.on(placed.collider)
        if not isinstance(found, ForceCorrection):
            raise SoftprintError(f"{correction} is not a correction by learned forces")
        mechanics = found.mechanics
        if own.internal is not None and not own.internal.on_condensation:
            mechanics = mechanics._replace(condensation=None)
        corrections.append(ForceCorrection(found.name, found.model, own.body, found.shape, mechanics))
    return ReducedModel(scene_simulator(own.body, parts, corrections, mechanics, own.internal), parts.held)


def row(name: str, model: ReducedModel, full: Motion, alone: float | None) -> tuple[str, float]:
    """A line of the table, and the median step in contact [s]. alone: that of the model as it is."""
    state = model.start().state
    off, missed, iterations, converged, seconds = [], [], [], [], []
    for frame in range(1, full.n_frames):
        began = time.perf_counter()
        result = model.step(state)
        taken, state = time.perf_counter() - began, result.state
        iterations.append(result.iterations)
        converged.append(result.converged)
        if full.in_contact[frame]:
            seconds.append(taken)
            off.append(rms(model.positions(state) - full.positions(frame)))
            missed.append(
                [result.contacts[one].force - track.force[frame] for one, track in full.colliders.items()]
            )
    step = float(np.median(seconds))
    force = rms(np.array([track.force[full.in_contact] for track in full.colliders.values()]))
    cells = [
        name,
        f"{1e3 * np.sqrt(np.mean(np.square(off))):.2f}",
        f"{rms(np.array(missed)):.2f} of {force:.2f}",
    ]
    cells += [f"{np.mean(iterations):.2f}", f"{np.mean(converged):.1%}", f"{step / (alone or step):.1f}"]
    return f"| {' | '.join(cells)} |", step


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml")
    parser.add_argument("--internal", type=Path, required=True, metavar="FILE.safetensors")
    parser.add_argument("--out", type=Path, default=None, metavar="RUN", help="run directory")
    parser.add_argument("--models", nargs="+", default=["mechanics", "ours"], metavar="NAME")
    options = parser.parse_args(arguments)
    context = Context(options.experiment, out=options.out, quiet=True)
    experiment, body, run = context.experiment, body_of_run(context), context.out_dir
    scene = experiment.scenes_of_role("test")[0]
    path = motion_path(run, scene.name, "full")
    if not path.is_file():
        raise SoftprintError(f"{path}: no such motion; make it with softprint simulate --model full")
    full = load_motion(path)
    if not full.in_contact.any():
        raise SoftprintError(f"{path}: nothing is touched in this motion")
    as_they_are = [corrected_model(experiment, body, scene, run, name) for name in options.models]
    changed = [
        on_internal(experiment, body, scene, correction_path(run, name), options.internal)
        for name in options.models
    ]
    print("| model | mm from full space | force, N off | Newton | converged | step |")
    print("| --- " * 6 + "|")
    for name, one, other in zip(options.models, as_they_are, changed, strict=True):
        line, alone = row(name, one, full, None)
        print(line, flush=True)
        print(row(f"{name} on {options.internal.stem}", other, full, alone)[0], flush=True)


if __name__ == "__main__":
    run_script(main)
