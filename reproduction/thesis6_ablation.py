"""What of the thesis's descriptor model matters? Variants trained alike on one truth, judged by shapes not learned from
(thesis, figures 6.3, 6.4 and 6.6; for 6.5 and 6.7 see `descriptor_ways.py`).

    python -m reproduction.thesis6_ablation EXPERIMENT [--out RUN] [--steps 1200] [--points 48] [--seeds 3]

Needs a truth of the library (`softprint generate`). Every variant has the same number of steps, settings and points of
interest (thesis 6.2.4), and is trained from several seeds. A table in Markdown, of means over the seeds and, in
brackets, of highest minus lowest. Errors are the thesis's measure, sum w |u_pred - u|^2 / sum w |u|^2 over points of
interest, u attenuated as it is learned, and averaged over two random tangent frames a point:

    learned from   the samples that were learned from
    states known   validation shapes, in states that were learned from with other shapes
    new state      validation shapes, in a state not learned from
    testing        the 22 testing shapes, in all states
    tangents       what two random tangent frames disagree about, RMS relative to that of the displacement, on
                   validation shapes in known states

Nothing is chosen here. The networks are kept as RUN/variants/NAME_SEED.safetensors, for `thesis6_figures.py`, and not
trained again while they are there; the table also goes to RUN/bench_thesis6_ablation.json, which `softprint report`
shows.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from softprint.runtime.arrays import BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import ANY_COLLIDER
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.io.files import atomic_path
from softprint.runtime.learned.correction_file import load_correction, read_header, save_correction
from softprint.runtime.learned.thesis6.correction import DescriptorCorrection
from softprint.runtime.learned.thesis6.descriptors.ball_rule import sample_pattern
from softprint.runtime.learned.thesis6.descriptors.local_descriptor import Samples
from softprint.runtime.learned.thesis6.entry import options as thesis6_options
from softprint.runtime.learned.thesis6.model import DescriptorModel
from softprint.runtime.shapes import names, validation_names
from softprint.runtime.truth.truth_file import TruthData, load_truth
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.registry import training_settings
from softprint.surrogate.thesis6.data import DescriptorData
from softprint.surrogate.thesis6.entry import descriptors, drawing
from softprint.surrogate.thesis6.loss import DescriptorLoss
from softprint.surrogate.thesis6.task import DescriptorTask
from softprint.surrogate.train import train

THESIS6 = ModelSpec(
    name="thesis6", form="thesis6", hidden=(150, 150, 150, 150, 50, 10), activation="elu", fade_depth=2e-3
)
# Name in the table -> what differs in the model, and the weight of the consistency loss.
VARIANTS: dict[str, tuple[dict[str, object], float]] = {
    "thesis6": ({}, 1.0),
    "raw normal": ({"differences": 0}, 1.0),
    "no consistency": ({}, 0.0),
    "half of the samples": ({"samples": "half"}, 1.0),
    "the centre alone": ({"samples": "one"}, 1.0),
}
SIDES = ("learned from", "states known", "new state", "testing")
KNOWN = SIDES[1]


def variant_path(run: Path, name: str, seed: int) -> Path:
    """Where a trained variant is kept."""
    return run / "variants" / f"{name.replace(' ', '_')}_{seed}.safetensors"


def load_variant(path: Path, body: ReducedBody) -> DescriptorModel:
    """A variant that was trained earlier."""
    found = load_correction(path, body, Sphere(0.01, body.dim))
    assert isinstance(found, DescriptorCorrection)
    return found.model


class Course:
    """Data of all sides, descriptors with all samples; those of variants are parts of them."""

    def __init__(self, learned: TrainingData, sets: int, most: int) -> None:
        spec = THESIS6.model_copy(update={"differences": sets})
        options = thesis6_options(spec, learned.body, PenaltyContact.of(learned.context.experiment.contact))
        sides = dict(zip(SIDES, _samples(learned, most), strict=True))
        self.data = {
            side: descriptors(learned, options, samples, drawing(learned)) for side, samples in sides.items()
        }

    def side(self, name: str, samples: Samples) -> DescriptorData:
        """Points of a side, told of some samples of the descriptor."""
        below = np.flatnonzero(sample_pattern(3)[:, 0] <= 0.0)
        kept = {"all": np.arange(len(sample_pattern(3))), "half": below, "one": np.array([0])}[samples]
        whole = self.data[name]
        return replace(whole, descriptor=whole.descriptor[..., torch.from_numpy(kept)])


def _samples(learned: TrainingData, most: int) -> Iterator[IntArray]:
    """Rows of the truth of each side, evenly drawn where there are more than `most`."""
    truth, rng = learned.truth, np.random.default_rng(0)
    states = np.unique(truth.sample_state[learned.split.train])
    validation = truth.usable & _of_shapes(truth, validation_names())
    known = np.flatnonzero(validation & np.isin(truth.sample_state, states))
    testing = np.flatnonzero(truth.usable & _of_shapes(truth, names("test")))
    yield learned.split.train
    for rows in (known, learned.held_out, testing):
        yield np.sort(rng.permutation(rows)[:most])


def _of_shapes(truth: TruthData, shapes: list[str]) -> BoolArray:
    numbers = [truth.header.colliders.index(name) for name in shapes if name in truth.header.colliders]
    return np.asarray(np.isin(truth.contacts["collider"][truth.samples["contact"]], numbers))


@torch.no_grad()
def of_interest(model: DescriptorModel, data: DescriptorData) -> tuple[float, float]:
    """Squared error, relative, and RMS disagreement of tangents, relative, over points of interest."""
    missed = apart = whole = 0.0
    for index in torch.arange(len(data)).split(4096):
        u = (data.rotation[index] @ model(data.inputs(index))[..., None])[..., 0]
        u = data.factor[index, None, None] * u
        weight, target = data.weight[index].double(), data.target[index]
        missed += float(weight @ (u - target[:, None]).square().sum(-1).mean(1).double())
        apart += float(weight @ (u - u.mean(1, keepdim=True)).square().sum(-1).mean(1).double())
        whole += float(weight @ target.square().sum(-1).double())
    return missed / whole, float(np.sqrt(apart / whole))


def trained(context: Context, learned: TrainingData, course: Course, name: str, seed: int) -> DescriptorModel:
    """One variant from one seed; read where it is there."""
    changes, consistency = VARIANTS[name]
    options = thesis6_options(
        THESIS6.model_copy(update=changes), learned.body, PenaltyContact.of(context.experiment.contact)
    )
    path, settings = variant_path(context.out_dir, name, seed), context.experiment.training.thesis6
    recipe = {"truth": learned.truth.content_hash, "settings": settings.model_dump(mode="json")}
    if path.is_file() and read_header(path).training == recipe:
        return load_variant(path, learned.body)
    data, judged = (course.side(side, options.samples) for side in (SIDES[0], KNOWN))
    task = DescriptorTask(options, DescriptorLoss(consistency, settings.input_gain), data, judged)
    steps = training_settings(context.experiment.training, "thesis6", seed)
    # The last weights: nothing is to be chosen.
    model = train(task, replace(steps, validations=1)).model
    rms = of_interest(model, judged)[0] ** 0.5
    path.parent.mkdir(exist_ok=True)
    save_correction(path, name, model, learned.body, ANY_COLLIDER, learned.truth.content_hash, rms, recipe)
    return model


def rows(context: Context, learned: TrainingData, seeds: int, most: int) -> Iterator[dict[str, str | float]]:
    """The lines of the table."""
    courses: dict[int, Course] = {}
    for name, (changes, _) in VARIANTS.items():
        spec = THESIS6.model_copy(update=changes)
        if spec.differences not in courses:
            courses[spec.differences] = Course(learned, spec.differences, most)
        course, started = courses[spec.differences], time.process_time()
        found = []
        for k in range(seeds):
            model = trained(context, learned, course, name, context.seed + k)
            judged = [of_interest(model, course.side(side, spec.samples)) for side in SIDES]
            found.append([error for error, _ in judged] + [judged[SIDES.index(KNOWN)][1]])
        mean, spread = np.mean(found, axis=0), np.ptp(found, axis=0)
        row: dict[str, str | float] = {"variant": name}
        for column, value, between in zip((*SIDES, "tangents"), mean, spread, strict=True):
            row |= {column: float(value), f"{column}, spread": float(between)}
        yield row | {"seconds": round((time.process_time() - started) / seeds, 1)}


def main() -> None:
    """Train, judge, and print line by line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory with truth.h5 (default: runs/NAME)")
    parser.add_argument("--steps", type=int, default=1200, help="optimiser steps of each variant")
    parser.add_argument("--points", type=int, default=48, help="points of interest of a sample")
    parser.add_argument("--seeds", type=int, default=3, help="trainings of each variant")
    parser.add_argument("--most", type=int, default=200, help="samples of each side to judge by, at most")
    options = parser.parse_args()
    overrides = (f"training.thesis6.steps={options.steps}", f"training.thesis6.points={options.points}")
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    body = body_of_run(context)
    if body.dim != 3:
        raise SoftprintError("descriptors of the thesis are in space: give an experiment in 3D")
    found = []
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        learned = TrainingData(truth, body, context)
        print(f"{len(learned.split.train)} samples to learn from\n")
        columns = (*SIDES, "tangents")
        print(f"| | {' | '.join(columns)} | CPU s |\n| --- {'| --- ' * (len(columns) + 1)}|", flush=True)
        for row in rows(context, learned, options.seeds, options.most):
            found.append(row)
            cells = [f"{row[column]:.1%} ({row[f'{column}, spread']:.1%})" for column in columns]
            print(f"| {row['variant']} | {' | '.join(cells)} | {row['seconds']:.0f} |", flush=True)
    with atomic_path(context.out_dir / "bench_thesis6_ablation.json") as temporary:
        temporary.write_text(json.dumps({"rows": found}, indent=1))


if __name__ == "__main__":
    run_script(main)
