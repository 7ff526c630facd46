"""One shape at the limit of what corrections for any collider can do, in numbers and one picture (thesis, figure 6.13).

    python -m reproduction.limit_case examples/hat_small.toml --out runs/jelly_library_small [--picture FILE.png]

Needs the motions of the test scene, full space among them (`softprint simulate`). Every correction in the run directory
is given the reduced state of each frame of the full-space motion in contact. A table in Markdown:

    error left   sqrt(sum d(model)^2 / sum d(bare)^2), d the distance of each node from full space
    near         the same over nodes within half the collider's size of it
    contact      sqrt(sum |u - u*|^2 / sum |u*|^2), u* the exact contact displacement at that state, on some frames
    into         how deep a surface node is in the collider, on average over the frames and at most [mm]
    alone        distance from the full-space motion, RMS over nodes and frames, of the motion that the model makes by
                 itself [mm]

--picture draws full space and the models side by side, cut open through the contact, by the means of the report, in the
frame where the bare subspace misses most.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softprint.fem_truth.report.assemble import JudgedScene
from softprint.fem_truth.report.drawing.panels import save_panels
from softprint.fem_truth.report.drawing.renderings import make_renderer
from softprint.fem_truth.report.make import judge_scene
from softprint.fem_truth.report.measurements.comparison import error_row, relative_displacement_error
from softprint.fem_truth.report.measurements.held_out import Comparer, SceneComparison
from softprint.fem_truth.report.measurements.motions import distances_over_time
from softprint.fem_truth.report.run_files import find_run_files, judged_scenes
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script

MODELS = ("full", "bare", "thesis6", "mechanics", "ours")  # drawn in this order


def table(judged: JudgedScene, comparison: SceneComparison) -> list[str]:
    """The lines of the table."""
    lines = ["| | error left | near | contact | into | alone |", "| --- | --- | --- | --- | --- | --- |"]
    full = judged.motions["full"]
    for name, frames in comparison.everywhere.items():
        row = error_row(frames)
        cells = [f"{row.relative_rms:.1%}", f"{row.relative_near_contact:.1%}"]
        missed = comparison.missed.get(name)
        cells += ["" if missed is None else f"{relative_displacement_error(missed, comparison.exact):.1%}"]
        cells += [f"{1e3 * row.mean_penetration:.2f}, {1e3 * row.max_penetration:.2f}"]
        motion = judged.motions.get(name) if name != "full" else None
        distance = None if motion is None else np.sqrt(np.mean(np.square(distances_over_time(motion, full))))
        cells += ["" if distance is None else f"{1e3 * distance:.2f}"]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def picture(path: Path, comparer: Comparer, comparison: SceneComparison, names: Sequence[str]) -> int:
    """Cuts side by side, in the frame where the bare subspace misses most, which is returned."""
    bare = comparison.everywhere["bare"]
    frame = int(bare.frames[np.argmax(bare.rms)])
    comparer.lead_to(frame, comparison.contact)
    pose, positions = comparer.motion.poses[frame], comparer.positions(frame)
    surface = comparer.body.mesh.surface_nodes
    deepest = surface[np.argmax(comparer.depth(positions["full"], pose))]
    renderer = make_renderer(comparer.body.mesh, comparer.collider, pose)
    row = []
    for name in names:
        shot = renderer.cut(positions[name], pose, positions["full"][deepest], name)
        row.append((name, shot or renderer.outside(positions[name], pose, name)))
    save_panels(path, [row])
    return frame


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--frames", type=int, default=12, help="on which full space is solved (default: 12)")
    parser.add_argument("--picture", type=Path, metavar="FILE.png")
    options = parser.parse_args()
    overrides = (f"report.frames={options.frames}",)
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    files, body = find_run_files(context.out_dir, context.experiment), body_of_run(context)
    for scene in judged_scenes(context.experiment):
        judged = judge_scene(context, files, body, scene)
        comparison = judged.comparison
        if comparison is None:
            print(f"{scene.name}: never touched")
            continue
        solved = len(comparison.exact)
        print(f"{scene.name}: {len(comparison.contact)} frames in contact, {solved} of them solved\n")
        print("\n".join(table(judged, comparison)))
        if options.picture:
            names = [name for name in MODELS if name in comparison.everywhere]
            print(f"\nframe {picture(options.picture, judged.comparer, comparison, names)} drawn")


if __name__ == "__main__":
    run_script(main)
