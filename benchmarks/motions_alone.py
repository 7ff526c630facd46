"""How far models that run alone are from full space, and from the force with which it meets a collider.

    python -m benchmarks.motions_alone FULL.h5 MOTION.h5 ...

Motions of one scene, as `softprint simulate` leaves them in RUN/motions. RMS over all nodes, and over the frames where
full space is in contact: sqrt(mean |x - x_full|^2) and, for every collider, sqrt(mean |f - f_full|^2), with what
|f_full| is; for colliders that move freely also how far the origin is from that in full space; Newton iterations a
step, and the share of all steps that converged.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.motion_file import Motion, load_motion


def rms(vectors: Array) -> float:
    """sqrt(mean |v|^2) of vectors (..., dim)."""
    return float(np.sqrt(np.square(vectors, dtype=np.float64).sum(axis=-1).mean()))


def line(*cells: str) -> str:
    """One line of a table in Markdown."""
    return "| " + " | ".join(cells) + " |"


def origins(motion: Motion, name: str) -> Array:
    """(F, dim) [m] of one collider over the frames."""
    return np.array([pose.translation for pose in motion.colliders[name].poses])


def row(motion: Motion, full: Motion, frames: IntArray, free: Sequence[str]) -> list[str]:
    """One line of the table: of the frames given. free: the colliders that have ways of their own."""
    if motion.scene != full.scene or motion.n_frames != full.n_frames:
        raise SoftprintError(f"the motions are not of one scene and length: {motion.scene}, {full.scene}")
    off = [rms(motion.positions(frame) - full.positions(frame)) for frame in frames]
    cells = [motion.model, f"{1e3 * np.sqrt(np.mean(np.square(off))):.2f}"]
    for name, track in full.colliders.items():
        missed = motion.colliders[name].force[frames] - track.force[frames]
        cells.append(f"{rms(missed):.2f} of {rms(track.force[frames]):.2f}")
    for name in free:
        apart = origins(motion, name) - origins(full, name)
        cells.append(f"{1e3 * rms(apart[frames]):.2f}")
    return [*cells, f"{motion.iterations[1:].mean():.2f}", f"{motion.converged[1:].mean():.1%}"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("full", type=Path, metavar="FULL.h5")
    parser.add_argument("motions", type=Path, nargs="+", metavar="MOTION.h5")
    options = parser.parse_args(arguments)
    full = load_motion(options.full)
    touched = np.flatnonzero(full.in_contact)
    if not touched.size:
        raise SoftprintError(f"{options.full}: nothing is touched in this motion")
    motions = [load_motion(path) for path in options.motions]
    # A collider that is led has the same poses in all motions.
    free = [
        name
        for name in full.colliders
        if any(
            len(motion.times) == len(full.times)
            and not np.array_equal(origins(motion, name), origins(full, name))
            for motion in motions
        )
    ]
    heads = ["model", "mm from full space", *(f"force on {name}, N off" for name in full.colliders)]
    heads += [f"{name}, mm off" for name in free]
    print(line(*heads, "Newton", "converged"))
    print("| --- " * (len(heads) + 2) + "|")
    for motion in motions:
        print(line(*row(motion, full, touched, free)))


if __name__ == "__main__":
    run_script(main)
