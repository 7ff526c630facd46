"""What of the thesis's descriptor model matters? Variants trained alike on one truth, judged by shapes not learned from
(thesis, figures 6.3, 6.4 and 6.6; for 6.5 and 6.7 see `descriptor_ways.py`).

    python -m benchmarks.thesis6_ablation EXPERIMENT [--out RUN] [--steps 2000] [--only NAME ...] [--test]

Needs a truth of the library (`softprint generate`). Every variant has the same number of steps, settings, seed and
points. A table in Markdown:

    held out      sqrt(<|u_pred - u|^2> / <|u|^2>) over volume and held-out samples, in the frames of run time; what
                  lies beyond d is missed by every variant
    of interest   the same over points of interest (thesis 6.2.4) and the attenuated displacement that is learned
    squared       of that, the thesis's measure
    learned from  the same of the samples that were learned from
    tangents      what two random tangent frames disagree about, RMS relative to that of the displacement

--test judges the 22 testing shapes too. Nothing may be chosen by that column.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from runtime.arrays import IntArray
from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.corrections.descriptor_model import DescriptorModel
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
VARIANTS: dict[str, tuple[dict[str, object], dict[str, object]]] = {
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


def held_out(model: DescriptorModel, data: DescriptorData) -> float:
    """Error over the volume."""
    missed, whole = sample_errors(model, data)
    return float((missed.sum() / whole.sum()).sqrt())


def of_testing_shapes(truth: TruthData, most: int) -> IntArray:
    """Some of the usable samples of the shapes to test with, evenly drawn."""
    numbers = [truth.header.colliders.index(name) for name in names("test") if name in truth.header.colliders]
    ours = np.isin(truth.contacts["collider"][truth.samples["contact"]], numbers)
    return np.sort(np.random.default_rng(0).permutation(np.flatnonzero(truth.usable & ours))[:most])


def main() -> None:
    """Train every variant and print its line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory with truth.h5 (default: runs/NAME)")
    parser.add_argument("--steps", type=int, default=2000, help="optimiser steps of each variant")
    parser.add_argument("--points", type=int, default=64, help="points of interest of a sample")
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), help="these variants alone")
    parser.add_argument("--test", action="store_true", help="judge the testing shapes too")
    options = parser.parse_args()
    overrides = (f"training.descriptor.steps={options.steps}", f"training.descriptor.points={options.points}")
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    experiment, body = context.experiment, body_of_run(context)
    columns = ["held out", "of interest", "squared", "learned from", "tangents", "CPU seconds"]
    if options.test:
        columns += ["test: of interest", "squared"]
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        lessons = Lessons(truth, body, context)
        print(f"{len(lessons.split.train)} samples to learn from, {len(lessons.held_out)} held out\n")
        print(f"| variant | {' | '.join(columns)} |\n| --- {'| --- ' * len(columns)}|", flush=True)
        for name in options.only or VARIANTS:
            model_changes, changes = VARIANTS[name]
            spec = THESIS6.model_copy(update=model_changes)
            started = time.process_time()
            task = lessons.descriptor_task(spec)
            if "consistency" in changes:
                task.weights = replace(task.weights, consistency=float(str(changes["consistency"])))
            settings = training_settings(experiment.training, spec.form, experiment.seed)
            # The last weights: judging all along the run would cost more than training.
            model = train(task, replace(settings, validations=1)).model
            seconds = time.process_time() - started
            judged = lessons.descriptors(model.options, lessons.held_out, lessons.drawing())
            error, tangents = of_interest(model, judged)
            cells = [
                held_out(model, task.validation),
                error,
                error**2,
                of_interest(model, task.data)[0],
                tangents,
            ]
            line = [f"{cell:.1%}" for cell in cells] + [f"{seconds:.0f}"]
            if options.test:
                judged = lessons.descriptors(
                    model.options, of_testing_shapes(truth, len(lessons.held_out)), lessons.drawing()
                )
                tested = of_interest(model, judged)[0]
                line += [f"{tested:.1%}", f"{tested**2:.1%}"]
            print(f"| {name} | {' | '.join(line)} |", flush=True)


if __name__ == "__main__":
    main()
