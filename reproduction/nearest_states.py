"""The training state nearest to the body beside frames of a motion (thesis, figure 5.8).

    softprint run examples/duck_small.toml
    python -m reproduction.nearest_states examples/duck_small.toml [--frames 5] [--picture FILE.png]

Needs the truth and the motions of the first test scene that a report judges. Frames in contact are drawn at random.
Nearness is that by which training states are chosen: the distance of rigid-free configurations, each edge of the graph
of handles scaled to unit variance (thesis 5.3.2). A table in Markdown:

    nearest   number of that state
    away      its distance from the frame, over the mean distance between two training states
    MODEL     error left by each correction at the state of that frame, over that of the bare subspace

--picture: full space above, with the collider, and the nearest training state, without contact, below.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.distance import cdist, pdist

from softprint.fem_truth.report.drawing.panels import save_panels
from softprint.fem_truth.report.drawing.renderings import make_renderer
from softprint.fem_truth.report.make import judge_scene
from softprint.fem_truth.report.measurements.held_out import Comparer
from softprint.fem_truth.report.run_files import find_run_files, judged_scenes
from softprint.fem_truth.sampling.rigid_free import RigidFreeDescriptor
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.truth.truth_file import TruthData, load_truth


def nearest(comparer: Comparer, frames: IntArray, states: Array) -> tuple[IntArray, Array]:
    """For each frame the training state that is nearest, and how far it is."""
    rows = np.array([comparer.rows(int(frame)) for frame in frames])
    numbers = RigidFreeDescriptor.of(comparer.body).normalised(np.concatenate([states, rows]))
    own, others = numbers[: len(states)], numbers[len(states) :]
    between = cdist(others, own)
    apart = float(pdist(own).mean()) if len(own) > 1 else 1.0
    return between.argmin(axis=1), between.min(axis=1) / apart


def errors(comparer: Comparer, frame: int, contact: IntArray) -> dict[str, float]:
    """Of every correction in a frame, over that of the bare subspace."""
    comparer.lead_to(frame, contact)
    positions = comparer.positions(frame)
    full = positions["full"]
    bare = np.linalg.norm(positions["bare"] - full)
    return {name: float(np.linalg.norm(positions[name] - full) / bare) for name in comparer.corrections}


def picture(path: Path, comparer: Comparer, frames: IntArray, states: IntArray, truth: TruthData) -> None:
    """Two rows: the frames, and below each its nearest training state at internal equilibrium."""
    poses, body = comparer.motion.poses, comparer.body
    renderer = make_renderer(body.mesh, comparer.collider, poses[int(frames[0])])
    above, below = [], []
    high = float(np.ptp(body.mesh.points[:, -1]))
    for frame, state in zip(map(int, frames), map(int, states), strict=True):
        above.append((f"frame {frame}", renderer.outside(comparer.motion.positions(frame), poses[frame], "")))
        away = poses[frame].translation + 4.0 * high * np.eye(body.dim)[-1]
        x = body.reduced_positions(truth.states["rows"][state]) + truth.internal(state)
        shot = renderer.outside(x, RigidPose(poses[frame].rotation, away), "")
        below.append((f"state {state}", shot))
    save_panels(path, [above, below])


def table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """In Markdown."""
    head = ["frame", "nearest", "away", *names]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--frames", type=int, default=5, help="how many (default: 5)")
    parser.add_argument("--picture", type=Path, metavar="FILE.png")
    given = parser.parse_args()
    context = Context(experiment_path=given.experiment, out=given.out, quiet=True)
    try:
        files, body = find_run_files(context.out_dir, context.experiment), body_of_run(context)
        judged = judge_scene(context, files, body, judged_scenes(context.experiment)[0])
        if files.truth is None or judged.comparison is None:
            raise SoftprintError(f"{context.out_dir}: needs a truth, and a test scene with contact")
        contact, comparer = judged.comparison.contact, judged.comparer
        chosen = np.random.default_rng(context.seed).permutation(contact)[: given.frames]
        frames = np.sort(chosen)
        with load_truth(files.truth, body) as truth:
            states, away = nearest(comparer, frames, truth.states["rows"])
            rows = []
            for frame, state, distance in zip(map(int, frames), states, away, strict=True):
                left = errors(comparer, frame, contact)
                cells = [str(frame), str(state), f"{distance:.2f}", *(f"{own:.1%}" for own in left.values())]
                rows.append(cells)
            print(table(list(comparer.corrections), rows))
            if given.picture:
                picture(given.picture, comparer, frames, states, truth)
    except SoftprintError as error:
        parser.error(str(error))


if __name__ == "__main__":
    run_script(main)
