"""Which inputs of the model for any collider pay? Trained without one group or another (see `inputs.py`).

    python -m reproduction.force_inputs_ablation EXPERIMENT [--out RUN] [--steps 800] [--seeds 2] [--every 3]

Needs a truth of the library (`softprint generate`). An input that is left out is zero for all samples. Every row has
the same samples (each --every-th one), steps and settings. A table in Markdown of the squared error over the volume,
sum |u - u*|^2 / sum |u*|^2, mean over the seeds and in brackets highest minus lowest: on validation shapes in a state
that training has not seen, and on testing shapes. Weights are the best of a run by the former. In the last row the
network is on its own: it corrects no forces of mechanics, and has no input from the linear mechanics of the body.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.force.confidence import Confidence
from softprint.runtime.learned.force.entry import options as force_options
from softprint.runtime.learned.force.inputs import DIRECTIONS
from softprint.runtime.learned.force.model import ForceModel
from softprint.runtime.shapes import names
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.force.data import ForceData
from softprint.surrogate.force.entry import force_data, metric
from softprint.surrogate.force.task import ForceTask, Samples
from softprint.surrogate.registry import training_settings
from softprint.surrogate.train import train

# Columns of the inputs, as `contact_inputs` and `inputs_around` lay them out.
CONTACT, STRAIN, CURVATURE = (*range(11), 27), tuple(range(11, 17)), tuple(range(17, 27))
MEANS, PLACE = tuple(range(28, 41)), (41, 42, 43)
ALL = (*CONTACT, *STRAIN, *CURVATURE, *MEANS, *PLACE)
VARIANTS: dict[str, tuple[int, ...]] = {
    "all of them (ours)": ALL,
    "no means around": tuple(k for k in ALL if k not in MEANS),
    "no curvature": tuple(k for k in ALL if k not in CURVATURE),
    "no strain": tuple(k for k in ALL if k not in STRAIN),
    "no rest position": tuple(k for k in ALL if k not in PLACE),
    "the contact and the rest position": (*CONTACT, *PLACE),
    "the contact alone": CONTACT,
}
# Those of how the linear body has given way, and of the collider where it has moved to.
OF_MECHANICS = (1, 3, 4, *range(6, 11), 16, 18, 20, *range(22, 28), 29, 31, *range(34, 39))
UNGUIDED = "no mechanics"


def told(data: ForceData, columns: Sequence[int]) -> ForceData:
    """The data with all other inputs zero."""
    kept = torch.zeros(data.local.shape[-1])
    kept[list(columns)] = 1.0
    return replace(data, local=data.local * kept)


def unguided(data: ForceData) -> ForceData:
    """The data without the contact forces of mechanics, the displacement by them, and the inputs that follow from
    either."""
    lever = data.lever.clone()
    lever[:, :, DIRECTIONS - 1] = 0.0
    columns = [k for k in ALL if k not in OF_MECHANICS]
    return replace(told(data, columns), force=torch.zeros_like(data.force), lever=lever)


class UnguidedTask(ForceTask):
    """Learned without mechanics, with contact forces of the same size. There are no forces of mechanics beside which a
    correction could be too large, so the confidence is 1."""

    def __init__(self, scale: Tensor, *parts: Any) -> None:
        super().__init__(*parts)
        self._scale = scale

    def fresh_model(self, seed: int) -> ForceModel:
        """See `ForceTask`."""
        model = super().fresh_model(seed)
        model.traction_scale.copy_(self._scale)
        model.confidence = Confidence(len(model.local_mean))
        return model

    def finish(self, model: ForceModel, batch: int = 256) -> None:
        """See `ForceTask`."""


def main() -> None:
    """Train, judge, and print line by line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--steps", type=int, default=800, help="optimiser steps of each training")
    parser.add_argument("--seeds", type=int, default=2, help="trainings of each row")
    parser.add_argument("--every", type=int, default=3, help="take each so manieth sample")
    options = parser.parse_args()
    overrides = (f"training.steps={options.steps}",)
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    body, spec = body_of_run(context), ModelSpec(name="ours")
    own = force_options(spec, body, PenaltyContact.of(context.experiment.contact))
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        whole = TrainingData(truth, body, context)
        collider = truth.contacts["collider"][truth.samples["contact"]]
        known = truth.header.colliders
        testing = [known.index(name) for name in names("test") if name in known]
        of_testing = np.flatnonzero(truth.usable & np.isin(collider, testing))
        chosen = (whole.split.train[:: options.every], whole.held_out, of_testing[:: options.every])
        data = [force_data(whole, spec, own, samples) for samples in chosen]
        measured_in = metric(whole, spec)
    print(f"{len(data[0])} samples to learn from, {len(data[1])} and {len(data[2])} to judge by\n")
    print("| inputs | their number | validation shapes | testing shapes | CPU s |")
    print("| --- | --- | --- | --- | --- |", flush=True)
    scale = ForceTask.of(own, measured_in, data[0], data[1], body.n_rows).fresh_model(0).traction_scale
    for name in (*VARIANTS, UNGUIDED):
        started = time.process_time()
        make: Callable[..., ForceTask]
        if name == UNGUIDED:
            make, (learned, *judged) = partial(UnguidedTask, scale), map(unguided, data)
        else:
            make, (learned, *judged) = ForceTask, (told(part, VARIANTS[name]) for part in data)
        samples = Samples.of(measured_in, learned)
        tasks = [make(own, samples, Samples.of(measured_in, side), body.n_rows) for side in judged]
        found = []
        for k in range(options.seeds):
            settings = training_settings(context.experiment.training, spec.form, context.seed + k)
            model = train(tasks[0], replace(settings, validations=8)).model
            found.append([task.held_out_error(model).squared for task in tasks])
        cells = [f"{m:.2%} ({s:.2%})" for m, s in zip(np.mean(found, 0), np.ptp(found, 0), strict=True)]
        seconds = (time.process_time() - started) / options.seeds
        count = len(VARIANTS.get(name, set(ALL) - set(OF_MECHANICS)))
        print(f"| {name} | {count} | {' | '.join(cells)} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    run_script(main)
