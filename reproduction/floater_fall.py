"""The Floater falls over the shell: when the shell has passed through it, by every model alone (thesis, figure 5.9).

    softprint run examples/floater_small.toml
    python -m reproduction.floater_fall examples/floater_small.toml [--plot FILE.png]

Needs the motions of the scene `fall`. The shell has passed when every node of the body is lower than the middle of the
shell, where it is widest. A table in Markdown:

    passed     when [s], between two frames by linear interpolation
    over full  the same over that of full space
    force      largest upward force on the body [N]
    pierced    frames in which the shell has pierced the body
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from softprint.fem_truth.report.run_files import find_run_files, load_motions
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.contact.intrusion import pierced_from
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import FULL
from softprint.runtime.scenes.motion_file import ColliderTrack, Motion
from softprint.runtime.scenes.scene import find_scene

SCENE = "fall"


def heights(motion: Motion, track: ColliderTrack) -> Array:
    """(n_frames,) [m]: the highest node of the body above the middle of the shell."""
    own = [motion.positions(frame)[:, -1].max() for frame in range(len(motion.times))]
    return np.array(own) - np.array([pose.translation[-1] for pose in track.poses])


def passage(times: Array, height: Array) -> float | None:
    """When the height goes below zero [s]; None if it never does."""
    below = np.flatnonzero(height < 0.0)
    if not len(below):
        return None
    after = int(below[0])
    if after == 0:
        return float(times[0])
    share = height[after - 1] / (height[after - 1] - height[after])
    return float(times[after - 1] + share * (times[after] - times[after - 1]))


def table(body: ReducedBody, motions: Mapping[str, Motion]) -> list[str]:
    """The lines of the table."""
    (shell,) = motions[FULL].colliders
    tracks = {name: motion.colliders[shell] for name, motion in motions.items()}
    passed = {name: passage(motion.times, heights(motion, tracks[name])) for name, motion in motions.items()}
    full = passed[FULL]
    lines = ["| model | passed | over full | force | pierced |", "| --- " * 5 + "|"]
    for name, track in tracks.items():
        when = passed[name]
        over = "" if when is None or full is None else f"{when / full:.3f}"
        pierced = int((np.nan_to_num(track.intrusion) > pierced_from(body.mesh)).sum())
        cells = [
            "stuck" if when is None else f"{when:.4f}",
            over,
            f"{-track.force[:, -1].min():.2f}",
            str(pierced),
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def plot(path: Path, motions: Mapping[str, Motion]) -> None:
    """The highest node above the middle of the shell, over time."""
    import matplotlib.pyplot as plt

    (shell,) = motions[FULL].colliders
    figure, axis = plt.subplots(figsize=(6.0, 3.2), layout="constrained")
    for name, motion in motions.items():
        height = 1e3 * heights(motion, motion.colliders[shell])
        axis.plot(motion.times, height, "k" if name == FULL else "-", label=name)
    axis.set_ylim(-120.0, None)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("highest node above\nthe middle of the shell [mm]")
    axis.legend(frameon=False)
    figure.savefig(path, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--plot", type=Path, metavar="FILE.png")
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, out=options.out, quiet=True)
    try:
        scene = find_scene(context.experiment, SCENE)
        files, body = find_run_files(context.out_dir, context.experiment), body_of_run(context)
        motions = load_motions(files, context.experiment, scene, body)
    except SoftprintError as error:
        parser.error(str(error))
    print("\n".join(table(body, motions)))
    if options.plot:
        plot(options.plot, motions)


if __name__ == "__main__":
    run_script(main)
