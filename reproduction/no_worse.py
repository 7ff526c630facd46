"""Is what is learned nowhere worse than linear mechanics? The drawn surface on held-out motions.

    python -m reproduction.no_worse EXPERIMENT [EXPERIMENT ...] [--out RUN [RUN ...]] [--model ours]

Each run needs its truth, the trained corrections `mechanics` and the model, and motions in full space of its scenes of
role `test` (`softprint simulate --model full`); scenes with one collider are compared. Printed in Markdown, for each
motion: the error left over that of the bare subspace (RMS over all nodes and all frames in contact, at the state of
full space) with mechanics, with the model, and with the model if its confidence were 1 everywhere; the mean confidence
over frames; how much of the network was kept; and the held-out errors of both, of single contacts.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from reproduction.confidence_check import MECHANICS, SURE, corrections_of
from softprint.fem_truth.report.measurements.comparison import error_row, pool
from softprint.fem_truth.report.measurements.held_out import Comparer, HeldOutMotion
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import SceneSpec
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.scene import scene_parts
from softprint.runtime.scenes.simulate import motion_path


def errors_on(
    context: Context, body: ReducedBody, scene: SceneSpec, model: str
) -> tuple[dict[str, float], float] | None:
    """The errors left by each model on one motion, and the mean confidence of the model; None without a motion of full
    space, and for scenes with another number of colliders than one."""
    placed, path = (
        scene_parts(context.experiment, scene).colliders,
        motion_path(context.out_dir, scene.name, "full"),
    )
    if len(placed) != 1 or not path.is_file():
        return None
    collider, full = placed[0].collider, load_motion(path)
    models = {
        name: StaticCorrection(correction, body)
        for name, correction in corrections_of(context.out_dir, body, collider, model).items()
    }
    poses = full.colliders[collider.name].poses
    motion = HeldOutMotion(full.times, poses, full.in_contact, full.positions)
    comparer = Comparer(body, collider, motion, models)
    comparer.begin()
    measured, confidence = [], list[float]()
    for frame in map(int, np.flatnonzero(full.in_contact)):
        measured.append(comparer.measure(frame))
        t = models[model].confidence(comparer.last_contact(model))
        confidence += [] if t is None else [t]
    if not measured:
        return None
    left = {name: error_row(pool([frame[name] for frame in measured])).relative_rms for name in models}
    return left, float(np.mean(confidence)) if confidence else 1.0


def lines(context: Context, model: str) -> Iterator[str]:
    """The lines of one run."""
    body, folder = body_of_run(context), context.out_dir / "corrections"
    curves = {name: folder / f"{name}.json" for name in (MECHANICS, model)}
    for path in curves.values():
        if not path.is_file():
            raise SoftprintError(f"{path}: there is no such model; train it with softprint train")
    found = {name: json.loads(path.read_text()) for name, path in curves.items()}
    samples = " → ".join(f"{found[name]['held_out']['rms']:.1%}" for name in found)
    kept = found[model].get("kept", {}).get("part", 1.0)
    for scene in context.experiment.scenes:
        measured = errors_on(context, body, scene, model) if scene.role == "test" else None
        if measured is not None:
            left, confidence = measured
            cells = [f"{left[name]:.2%}" for name in (MECHANICS, model, SURE)]
            name = f"{context.experiment.name}, {scene.name}"
            yield f"| {' | '.join([name, *cells, f'{confidence:.2f}', f'{kept:.0%}', samples])} |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiments", type=Path, nargs="+", metavar="EXPERIMENT")
    parser.add_argument(
        "--out", type=Path, nargs="*", default=[], help="run directories (default: runs/NAME)"
    )
    parser.add_argument("--model", default="ours")
    options = parser.parse_args()
    if options.out and len(options.out) != len(options.experiments):
        parser.error("--out: as many run directories as experiments")
    heads = ("motion", MECHANICS, options.model, SURE, "confidence", "kept", "single contacts")
    print(f"| {' | '.join(heads)} |\n{'| --- ' * len(heads)}|")
    for experiment, out in zip(
        options.experiments, options.out or [None] * len(options.experiments), strict=True
    ):
        try:
            for line in lines(Context(experiment_path=experiment, out=out, quiet=True), options.model):
                print(line, flush=True)
        except (SoftprintError, OSError) as error:
            parser.error(str(error))


if __name__ == "__main__":
    run_script(main)
