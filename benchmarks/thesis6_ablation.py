"""What of the thesis's descriptor model matters? Variants trained alike on one truth, judged by shapes not learned from
(thesis, figures 6.3, 6.4 and 6.6; for 6.5 and 6.7 see `descriptor_ways.py`).

    python -m benchmarks.thesis6_ablation EXPERIMENT [--out RUN] [--steps 1500] [--only NAME ...]
    python -m benchmarks.thesis6_ablation EXPERIMENT [--out RUN] --trained thesis6 [--test]

Needs a truth of the library (`softprint generate`). Every variant has the same number of steps, settings, seed and
points. A table in Markdown, of held-out samples:

    volume        sqrt(<|u_pred - u|^2> / <|u|^2>) over the body, in the frames of run time; what lies beyond d is
                  missed by every variant
    of interest   the same over points of interest (thesis 6.2.4) and the attenuated displacement that is learned
    squared       of that, the thesis's measure
    tangents      what two random tangent frames disagree about, RMS relative to that of the displacement
    learned from  "of interest" for the samples that were learned from

With --trained the model of that name in the run is judged instead, with --test also by the 22 testing shapes. Nothing
may be chosen by these.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from runtime.arrays import IntArray
from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.colliders.build import build_collider
from runtime.corrections.correction_file import load_correction
from runtime.corrections.descriptor_contact import DescriptorContact
from runtime.corrections.descriptor_model import DescriptorModel
from runtime.dynamics.model import correction_path
from runtime.errors import SoftprintError
from runtime.experiment import Experiment
from runtime.experiment.training_schema import ModelSpec
from runtime.shapes import names
from runtime.truth_file import TruthData, load_truth
from surrogate.descriptor_data import DescriptorData
from surrogate.descriptor_task import sample_errors
from surrogate.run_training import Lessons, training_settings
from surrogate.train import train

THESIS6 = ModelSpec(
    name="thesis6", form="descriptor", hidden=(150, 150, 150, 150, 50, 10), activation="elu", fade_depth=2e-3
)
# Name in the table, what differs in the model, and in [training.descriptor].
VARIANTS: dict[str, tuple[dict[str, object], dict[str, float]]] = {
    "thesis6": ({}, {}),
    "raw normal": ({"differences": 0}, {}),
    "no consistency": ({}, {"consistency": 0.0}),
    "half of the samples": ({"samples": "half"}, {}),
    "the centre alone": ({"samples": "one"}, {}),
}


@torch.no_grad()
def of_interest(model: DescriptorModel, data: DescriptorData) -> tuple[float, float]:
    """Error and disagreement of tangents, relative, over points of interest."""
    missed = apart = whole = 0.0
    for index in torch.arange(len(data)).split(4096):
        u = (data.rotation[index] @ model(data.inputs(index))[..., None])[..., 0]
        u = data.factor[index, None, None] * u
        weight, target = data.weight[index].double(), data.target[index]
        missed += float(weight @ (u - target[:, None]).square().sum(-1).mean(1).double())
        apart += float(weight @ (u - u.mean(1, keepdim=True)).square().sum(-1).mean(1).double())
        whole += float(weight @ target.square().sum(-1).double())
    return float(np.sqrt(missed / whole)), float(np.sqrt(apart / whole))


def judge(lessons: Lessons, model: DescriptorModel, samples: IntArray) -> list[str]:
    """volume, of interest, squared, tangents."""
    missed, whole = sample_errors(model, lessons.descriptors(model.options, samples, None))
    drawn = lessons.descriptors(model.options, samples, lessons.drawing())
    error, tangents = of_interest(model, drawn)
    volume = float((missed.sum() / whole.sum()).sqrt())
    return [f"{number:.1%}" for number in (volume, error, error**2, tangents)]


def of_testing_shapes(truth: TruthData, most: int) -> IntArray:
    """Some of the usable samples of the shapes to test with, evenly drawn."""
    numbers = [truth.header.colliders.index(name) for name in names("test") if name in truth.header.colliders]
    ours = np.isin(truth.contacts["collider"][truth.samples["contact"]], numbers)
    return np.sort(np.random.default_rng(0).permutation(np.flatnonzero(truth.usable & ours))[:most])


def variants(
    lessons: Lessons, experiment: Experiment, wanted: Sequence[str]
) -> Iterator[tuple[str, list[str]]]:
    """Train them, one after the other."""
    for name in wanted:
        model_changes, changes = VARIANTS[name]
        started = time.process_time()
        task = lessons.descriptor_task(THESIS6.model_copy(update=model_changes))
        task.weights = replace(task.weights, **changes)
        settings = training_settings(experiment.training, "descriptor", experiment.seed)
        # The last weights: judging all along the run would cost more than training.
        model = train(task, replace(settings, validations=1)).model
        learned = of_interest(model, task.data)[0]
        seconds = time.process_time() - started
        yield name, [*judge(lessons, model, lessons.held_out), f"{learned:.1%}", f"{seconds:.0f}"]


def trained(
    lessons: Lessons, context: Context, name: str, sides: dict[str, IntArray]
) -> Iterator[tuple[str, list[str]]]:
    """Judge a trained model by samples of each side."""
    some = lessons.truth.header.colliders[0]
    collider = build_collider(context.experiment.collider(some), context.experiment.base_dir)
    correction = load_correction(correction_path(context.out_dir, name), lessons.body, collider)
    if not isinstance(correction, DescriptorContact):
        raise SoftprintError(f"{name} is not a correction of form descriptor")
    for side, samples in sides.items():
        yield f"{name}, {side}", judge(lessons, correction.model, samples)


def main() -> None:
    """Judge, and print line by line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory with truth.h5 (default: runs/NAME)")
    parser.add_argument("--steps", type=int, default=1500, help="optimiser steps of each variant")
    parser.add_argument("--points", type=int, default=64, help="points of interest of a sample")
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), help="these variants alone")
    parser.add_argument("--trained", help="judge this correction of the run instead")
    parser.add_argument("--test", action="store_true", help="by the testing shapes too")
    options = parser.parse_args()
    overrides = (f"training.descriptor.steps={options.steps}", f"training.descriptor.points={options.points}")
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    experiment, body = context.experiment, body_of_run(context)
    columns = ["volume", "of interest", "squared", "tangents"]
    if not options.trained:
        columns += ["learned from", "CPU seconds"]
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        lessons = Lessons(truth, body, context)
        print(f"{len(lessons.split.train)} samples to learn from, {len(lessons.held_out)} held out\n")
        print(f"| | {' | '.join(columns)} |\n| --- {'| --- ' * len(columns)}|", flush=True)
        if options.trained:
            sides = {"held out": lessons.held_out}
            if options.test:
                sides["testing shapes"] = of_testing_shapes(truth, experiment.training.validation_samples)
            lines = trained(lessons, context, options.trained, sides)
        else:
            lines = variants(lessons, experiment, options.only or list(VARIANTS))
        for name, cells in lines:
            print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
