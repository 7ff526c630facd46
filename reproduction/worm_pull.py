"""The Worm pulled past six pins: the pulling force over time, by every model alone (thesis, figure 4.10).

    softprint run examples/worm_small.toml
    python -m reproduction.worm_pull examples/worm_small.toml [--plot FILE.png]

Needs the motions of the scene `pull`. The worm is pulled by a spring on its foremost bone; its force along the way is
k (target - bone). Corrections are those of one pin, for each of the six. A table in Markdown:

    peak       largest pulling force [N]
    over full  the same over that of full space
    RMS        of the force, its difference from that of full space [N]
    behind     how far the pulled bone is behind that of full space at the end [mm]
    pierced    frames in which a pin has pierced the body
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
from softprint.runtime.dynamics.terms.springs import HandleSpring
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, SceneSpec
from softprint.runtime.experiment.experiment import FULL
from softprint.runtime.scenes.motion_file import Motion
from softprint.runtime.scenes.scene import find_scene, scene_parts

SCENE = "pull"


def pulling_spring(experiment: Experiment, scene: SceneSpec) -> HandleSpring:
    """The one spring of the scene, on a frame. Raises SoftprintError where there is another number of them."""
    springs = scene_parts(experiment, scene).springs
    if len(springs) != 1 or not isinstance(springs[0].handle, str):
        raise SoftprintError(
            f"scene {scene.name!r}: is pulled by one spring on a frame, but has {len(springs)} springs"
        )
    return springs[0]


def pulled_positions(body: ReducedBody, motion: Motion, spring: HandleSpring) -> Array:
    """(n_frames, dim) [m]: where the middle of the pulled frame is."""
    frame = next(frame for frame in body.handles.frames if frame.name == spring.handle)
    if motion.model == FULL:  # where the frame is elastic
        return np.array([motion.positions(f)[frame.nodes].mean(axis=0) for f in range(len(motion.times))])
    return np.einsum("r,frd->fd", body.basis[frame.nodes].mean(axis=0), motion.rows)


def pulling_force(body: ReducedBody, motion: Motion, spring: HandleSpring) -> Array:
    """(n_frames,) [N] along the way of the target."""
    targets = np.array([spring.target.pose(time).translation for time in motion.times])
    along = targets[-1] - targets[0]
    force = spring.stiffness * (targets - pulled_positions(body, motion, spring))
    return np.asarray(force @ (along / np.linalg.norm(along)))


def table(body: ReducedBody, motions: Mapping[str, Motion], spring: HandleSpring) -> list[str]:
    """The lines of the table."""
    force = {name: pulling_force(body, motion, spring) for name, motion in motions.items()}
    last = {name: pulled_positions(body, motion, spring)[-1] for name, motion in motions.items()}
    lines = ["| model | peak | over full | RMS | behind | pierced |", "| --- " * 6 + "|"]
    for name, motion in motions.items():
        tracks = motion.colliders.values()
        deepest = np.max([np.nan_to_num(track.intrusion) for track in tracks], axis=0)
        pierced = int((deepest > pierced_from(body.mesh)).sum())
        peak, off = force[name].max(), np.sqrt(np.mean((force[name] - force[FULL]) ** 2))
        behind = 1e3 * np.linalg.norm(last[name] - last[FULL])
        cells = [
            f"{peak:.1f}",
            f"{peak / force[FULL].max():.2f}",
            f"{off:.1f}",
            f"{behind:.1f}",
            str(pierced),
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def plot(path: Path, body: ReducedBody, motions: Mapping[str, Motion], spring: HandleSpring) -> None:
    """Force over time; the axis ends at twice the peak of full space."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(7.0, 3.2), layout="constrained")
    for name, motion in motions.items():
        force = pulling_force(body, motion, spring)
        axis.plot(
            motion.times,
            force,
            "k" if name == FULL else "-",
            label=name,
            linewidth=1.6 - 0.4 * (name != FULL),
        )
        if name == FULL:
            axis.set_ylim(1.5 * force.min(), 2.5 * force.max())
    axis.set_xlabel("time [s]")
    axis.set_ylabel("pulling force [N]")
    axis.legend(frameon=False, ncols=len(motions))
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
        spring = pulling_spring(context.experiment, scene)
        files, body = find_run_files(context.out_dir, context.experiment), body_of_run(context)
        motions = load_motions(files, context.experiment, scene, body)
        if FULL not in motions:
            raise SoftprintError(f"{SCENE!r} has no motion of full space: softprint simulate --scene {SCENE}")
    except SoftprintError as error:
        parser.error(str(error))
    print("\n".join(table(body, motions, spring)))
    if options.plot:
        plot(options.plot, body, motions, spring)


if __name__ == "__main__":
    run_script(main)
