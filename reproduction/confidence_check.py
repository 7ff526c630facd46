"""Does the confidence factor of a correction say how wrong it is? Promised against found error on motions.

    python -m reproduction.confidence_check EXPERIMENT --calibrate SCENE [SCENE ...] --judge SCENE [SCENE ...]
        [--out RUN] [--model ours] [--frames 12] [--picture FILE.png]

SCENE is a scene of the experiment, or SCENE=SHAPE for one with another shape of the library in the place of its
collider (`softprint simulate --scene SCENE --collider SHAPE`); each needs its motion in full space. On some frames in
contact of each, full space is solved at the state of the frame, which gives the exact contact displacement u*. The
relative error of a model there is e = |u - u*| / |u*| over the nodes, and t its confidence, 1 inside of the range of
training, 0 where linear mechanics remains. Calibrated is

    promised^2 = t^2 e_1^2 + (1 - t^2) e_0^2,

with e_1 and e_0 from the motions to calibrate on, by least squares. Printed in Markdown: for each motion the mean of t,
promised and found error (RMS over its frames), that of mechanics, and that of the correction without confidence; and
the same over bins of t of the motions to judge by.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.report.measurements.comparison import evenly_spaced
from softprint.fem_truth.report.measurements.held_out import Comparer, HeldOutMotion
from softprint.fem_truth.report.measurements.solves import solve_frame
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.arrays import Array, BoolArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, SceneSpec
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.learned.force.confidence import Confidence
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.replaced_collider import with_replaced_collider
from softprint.runtime.scenes.scene import scene_parts
from softprint.runtime.scenes.simulate import motion_path

MECHANICS, SURE = "mechanics", "without confidence"
# Bins of t.
BINS = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0)


@dataclass(frozen=True, eq=False)
class Frames:
    """n frames of a motion: t, and e^2 by model (n,)."""

    scene: str
    confidence: Array
    squared: dict[str, Array]

    def of(self, which: BoolArray) -> Frames:
        """Some of them."""
        return Frames(
            self.scene, self.confidence[which], {name: e[which] for name, e in self.squared.items()}
        )


def scene_of(experiment: Experiment, option: str) -> tuple[Experiment, SceneSpec]:
    """The scene that SCENE or SCENE=SHAPE names. Raises SoftprintError for none of the experiment."""
    name, _, shape = option.partition("=")
    found = [scene for scene in experiment.scenes if scene.name == name]
    if not found:
        known = ", ".join(scene.name for scene in experiment.scenes)
        raise SoftprintError(f"{name}: the experiment has no such scene; it has {known}")
    return with_replaced_collider(experiment, found[0], shape) if shape else (experiment, found[0])


def corrections_of(
    run: Path, body: ReducedBody, collider: Collider, model: str
) -> dict[str, ForceCorrection]:
    """Mechanics, the model, and the model with a confidence of 1 everywhere."""
    found = {}
    for name, file in ((MECHANICS, MECHANICS), (model, model), (SURE, model)):
        correction = load_correction(run / f"corrections/{file}.safetensors", body, collider)
        if not isinstance(correction, ForceCorrection):
            raise SoftprintError(f"{file} is not a correction by learned forces, and has no confidence")
        found[name] = correction
    found[SURE].model.confidence = Confidence(len(found[SURE].model.local_mean))
    return found


def measured(context: Context, body: ReducedBody, option: str, model: str, n_frames: int) -> Frames:
    """The frames of one motion."""
    experiment, scene = scene_of(context.experiment, option)
    (placed,) = scene_parts(experiment, scene).colliders
    collider, path = placed.collider, motion_path(context.out_dir, scene.name, "full")
    if not path.is_file():
        raise SoftprintError(f"{path}: no such motion; make it with softprint simulate --model full")
    full = load_motion(path)
    models = {
        name: StaticCorrection(correction, body)
        for name, correction in corrections_of(context.out_dir, body, collider, model).items()
    }
    poses = full.colliders[collider.name].poses
    comparer = Comparer(
        body, collider, HeldOutMotion(full.times, poses, full.in_contact, full.positions), models
    )
    gravity = np.array(experiment.dynamics.gravity)
    law = PenaltyContact.of(experiment.contact)
    problem = ConstrainedProblem(FullSpaceElasticity(body), gravity, law, body)
    contact, _ = comparer.contact_frames()
    asked, confidence = set(evenly_spaced(contact, n_frames)), list[float]()
    squared: dict[str, list[float]] = {name: [] for name in models}
    comparer.begin()
    for frame in map(int, contact):
        rows, pose = comparer.rows(frame), poses[frame]
        found = {name: comparer.contact_displacement(name, rows, pose) for name in models}
        t = models[model].confidence(comparer.last_contact(model))
        if frame not in asked or t is None:
            continue
        solves = solve_frame(problem, rows, comparer.reduced(frame), full.positions(frame), collider, pose)
        if solves.problem:
            continue
        confidence.append(t)
        for name, u in found.items():
            missed = np.square(u - solves.exact).sum() / np.square(solves.exact).sum()
            squared[name].append(float(missed))
    return Frames(scene.name, np.array(confidence), {name: np.array(e) for name, e in squared.items()})


def calibrated(frames: Sequence[Frames], model: str) -> tuple[float, float]:
    """e_1 and e_0, not negative."""
    t = np.concatenate([own.confidence for own in frames])
    found = np.concatenate([own.squared[model] for own in frames])
    sure, unsure = np.linalg.lstsq(np.stack([t**2, 1.0 - t**2], axis=1), found, rcond=None)[0]
    return float(np.sqrt(max(sure, 0.0))), float(np.sqrt(max(unsure, 0.0)))


def promised(t: Array, errors: tuple[float, float]) -> Array:
    """The promised error (n,) at confidences (n,)."""
    return np.sqrt(t**2 * errors[0] ** 2 + (1.0 - t**2) * errors[1] ** 2)


def line(name: str, own: Frames, errors: tuple[float, float], model: str) -> str:
    """One line of a table."""
    promise = np.sqrt(np.mean(promised(own.confidence, errors) ** 2))
    cells = [name, str(len(own.confidence)), f"{own.confidence.mean():.2f}", f"{promise:.1%}"]
    cells += [f"{np.sqrt(own.squared[key].mean()):.1%}" for key in (model, MECHANICS, SURE)]
    return f"| {' | '.join(cells)} |"


def picture(path: Path, parts: dict[str, Sequence[Frames]], errors: tuple[float, float], model: str) -> None:
    """Every frame: found over promised error."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5.2, 4.6), layout="constrained")
    for (label, frames), marker in zip(parts.items(), "os", strict=True):
        t = np.concatenate([own.confidence for own in frames])
        found = np.sqrt(np.concatenate([own.squared[model] for own in frames]))
        axes.plot(promised(t, errors), found, marker, ms=4, alpha=0.6, label=label)
    low, high = axes.get_ylim()[0], axes.get_ylim()[1]
    axes.plot([0.0, 1.0], [0.0, 1.0], color="0.5", lw=1, label="found as promised")
    axes.set(
        xlim=(0.0, 1.2 * max(errors)),
        ylim=(min(low, 0.0), high),
        xlabel="promised error of the contact displacement",
        ylabel="found error",
    )
    axes.legend()
    figure.savefig(path, dpi=150)


def main() -> None:
    """Measure, calibrate, print and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--calibrate", nargs="+", required=True, metavar="SCENE", help="to calibrate on")
    parser.add_argument("--judge", nargs="+", required=True, metavar="SCENE", help="to judge by")
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--model", default="ours")
    parser.add_argument("--frames", type=int, default=12, help="of each motion, solved in full space")
    parser.add_argument("--picture", type=Path, metavar="FILE.png")
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, out=options.out, quiet=True)
    body = body_of_run(context)

    def frames(scenes: Sequence[str]) -> list[Frames]:
        return [measured(context, body, scene, options.model, options.frames) for scene in scenes]

    kept, judged = frames(options.calibrate), frames(options.judge)
    errors = calibrated(kept, options.model)
    print(f"e_1 = {errors[0]:.1%}, e_0 = {errors[1]:.1%}\n")
    heads = ("motion", "frames", "t", "promised", "found", MECHANICS, SURE)
    print(f"| {' | '.join(heads)} |\n{'| --- ' * len(heads)}|")
    for group, found in (("calibrated on", kept), ("judged", judged)):
        for own in found:
            print(line(f"{group}: {own.scene}", own, errors, options.model))
    together = Frames(
        "all judged",
        np.concatenate([own.confidence for own in judged]),
        {
            name: np.concatenate([own.squared[name] for own in judged])
            for name in (options.model, MECHANICS, SURE)
        },
    )
    for low, high in pairwise(BINS):
        inside = (together.confidence > low) & (together.confidence <= high)
        if inside.any():
            print(line(f"all judged, t from {low} to {high}", together.of(inside), errors, options.model))
    if options.picture:
        picture(options.picture, {"calibrated on": kept, "judged": judged}, errors, options.model)


if __name__ == "__main__":
    run_script(main)
