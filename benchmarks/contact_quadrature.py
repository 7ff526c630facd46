"""Whether contact in full space has enough points for a motion; and models, against full space with the most.

    softprint simulate EXPERIMENT.toml --model full --set contact.refinement=8 --out RUN_8 --scene SCENE ...
    python -m benchmarks.contact_quadrature RUN/motions/SCENE_full.h5 ... --finer RUN_4 RUN_8 [--models mechanics ours]

Each motion of full space is there once more in every run that is given as finer, with more points on every facet; the
last is the reference. Error of the force on the collider over the force, RMS over the frames in which the reference is
in contact: of full space with fewer points, and of the motions of models beside the first; then the share of steps of
the reference that converge. The few points of a facet may catch on a sharp edge. A motion in which the two finest of
full space differ by --within or more depends on how many points there are; the last line leaves it out.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.motions_alone import line, rms
from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.motion_file import Motion, load_motion


def force_errors(motions: Sequence[Motion], reference: Motion) -> Array:
    """(n,) of motions of one scene, over the force of the reference."""
    ((name, track), *others), frames = reference.colliders.items(), np.flatnonzero(reference.in_contact)
    if others:
        raise SoftprintError(f"{reference.path}: is of several colliders: give motions with one")
    if not frames.size:
        raise SoftprintError(f"{reference.path}: nothing is touched in this motion")
    force = rms(track.force[frames])
    for motion in motions:
        if motion.scene != reference.scene or motion.n_frames != reference.n_frames:
            raise SoftprintError(
                f"{motion.path} and {reference.path}: are not motions of one scene and length; play both alike"
            )
    return np.array([rms(of.colliders[name].force[frames] - track.force[frames]) / force for of in motions])


def points_of(motion: Motion) -> str:
    """How many points a facet has, as a heading."""
    if motion.contact is None:
        raise SoftprintError(f"{motion.path}: does not say how contact is evaluated: simulate it again")
    dim = motion.rows.shape[2]
    return f"full space, {motion.contact.refinement ** (dim - 1)} points"


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown, row by row, and the RMS over all motions and over those that points do not change."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("motions", type=Path, nargs="+", metavar="FULL.h5")
    parser.add_argument("--finer", type=Path, nargs="+", required=True, metavar="RUN")
    parser.add_argument("--models", nargs="+", default=["mechanics", "ours"], metavar="NAME")
    parser.add_argument("--within", type=float, default=0.01, help="share of the force (default: 0.01)")
    options = parser.parse_args(arguments)
    rows = list[Array]()
    for path in options.motions:
        *coarser, reference = [
            load_motion(path),
            *(load_motion(run / "motions" / path.name) for run in options.finer),
        ]
        models = [
            load_motion(path.with_name(f"{reference.scene}_{model}.h5")) for model in options.models
        ]
        if not rows:
            heads = ["motion", "force, N", *map(points_of, coarser), *options.models, "converged"]
            print(line(*heads))
            print("| --- " * len(heads) + "|")
        rows.append(force_errors([*coarser, *models], reference))
        (track,) = reference.colliders.values()
        force = rms(track.force[reference.in_contact])
        cells = map("{:.1%}".format, [*rows[-1], reference.converged[1:].mean()])
        print(line(reference.scene, f"{force:.2f}", *cells), flush=True)
    errors = np.array(rows)
    agree = errors[:, len(options.finer) - 1] < options.within
    for of, which in (("all", np.ones(len(rows), dtype=bool)), (f"agree to {options.within:.0%}", agree)):
        if which.any():
            overall = np.sqrt(np.square(errors[which]).mean(axis=0))
            print(line(f"RMS over {which.sum()} motions: {of}", "", *map("{:.1%}".format, overall), ""))


if __name__ == "__main__":
    run_script(main)
