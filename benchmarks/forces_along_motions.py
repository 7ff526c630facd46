"""The force on a collider at the states that full space goes through in a motion.

    python -m benchmarks.forces_along_motions EXPERIMENT.toml FULL.h5 ... [--out RUN] [--models ours ...]

FULL.h5: motions of full space with one collider each, as `softprint simulate --model full` leaves them in RUN/motions.
Each model of contact is put at the handle rows and the pose of every frame, and follows its contact from one to the
next, so that what is off is contact alone: in a motion that a model plays by itself (`benchmarks.motions_alone`), its
handles are off, too, and the one error bends the other. RMS over the frames in which full space is in contact, in
newtons, and as a share of the force; and over the motions, as the RMS of these shares. Without friction.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.handle_forces import BARE, Model
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, load_body
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.script import run_script
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.correction_file import read_correction
from softprint.runtime.scenes.motion_file import Motion, load_motion


def force_errors(model: Model, body: ReducedBody, motion: Motion) -> tuple[float, float]:
    """RMS [N] of what a model's force on the collider is off, and of the force, over the frames in contact."""
    (name, collider), *others = motion.build_colliders().items()
    if others:
        raise SoftprintError(f"{motion.path}: is of several colliders: give motions with one")
    track, frames = motion.colliders[name], np.flatnonzero(motion.in_contact)
    if not frames.size:
        raise SoftprintError(f"{motion.path}: nothing is touched in this motion")
    last = frames[-1] + 1
    states = (Configuration(motion.rows[k], {name: track.poses[k]}) for k in range(last))
    found = np.array([body.handles.affine_part @ h for h in model.on(collider).along(states)])
    return _rms(found[frames] - track.force[frames]), _rms(track.force[frames])


def _rms(vectors: Array) -> float:
    """sqrt(mean |v|^2) of vectors (n, dim)."""
    return float(np.sqrt(np.square(vectors).sum(axis=1).mean()))


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml")
    parser.add_argument("motions", type=Path, nargs="+", metavar="FULL.h5")
    parser.add_argument("--out", type=Path, default=None, metavar="RUN", help="run directory")
    parser.add_argument("--models", nargs="+", default=["mechanics", "ours"], metavar="NAME")
    options = parser.parse_args(arguments)
    context = Context(options.experiment, out=options.out)
    if context.experiment.contact.friction:
        raise SoftprintError(f"{options.experiment}: contact is rough, and the force here is without friction")
    body = load_body(context.out_dir / "body.h5")
    models = {}
    for name in options.models:
        path = context.out_dir / f"corrections/{name}.safetensors"
        models[name] = Model(body, context.experiment, None if name == BARE else read_correction(path, body))
    print("| " + " | ".join(["motion", "force, N", *(f"{name}: N off, share" for name in models)]) + " |")
    print("| --- " * (len(models) + 2) + "|")
    shares = list[list[float]]()
    for motion in map(load_motion, options.motions):
        errors = [force_errors(model, body, motion) for model in models.values()]
        shares.append([off / force for off, force in errors])
        cells = [f"{off:.2f}, {off / force:.1%}" for off, force in errors]
        print("| " + " | ".join([motion.scene, f"{errors[0][1]:.2f}", *cells]) + " |", flush=True)
    overall = np.sqrt(np.mean(np.square(shares), axis=0))
    print("| " + " | ".join(["RMS over motions", "", *(f"{share:.1%}" for share in overall)]) + " |")


if __name__ == "__main__":
    run_script(main)
