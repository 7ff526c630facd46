"""Which inputs of the model for any collider pay? Trained without one group or another (see `inputs.py`).

    python -m benchmarks.load_inputs_ablation EXPERIMENT [--out RUN] [--steps 800] [--seeds 2] [--every 3]

Needs a truth of the library (`softprint generate`). An input that is left out is zero for all samples. Every row has
the same samples (each --every-th one), steps and settings. A table in Markdown of the squared error over the volume,
sum |u - u*|^2 / sum |u*|^2, mean over the seeds and in brackets highest minus lowest: on validation shapes in a state
not learned from, and on testing shapes. Weights are the best of a run by the former. In the last row the network is
on its own: it corrects nothing, and is told nothing of what linear mechanics of the body makes of the contact.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.experiment.training_schema import ModelSpec
from runtime.learned.force.confidence import Confidence
from runtime.learned.force.inputs import DIRECTIONS
from runtime.learned.force.model import ForceModel
from runtime.learned.options import force_model_options
from runtime.shapes import names
from runtime.truth.truth_file import load_truth
from surrogate.load_task import ForceData, ForceTask
from surrogate.run_training import Lessons, training_settings
from surrogate.train import train

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
    """The data without the loads that mechanics gives, the displacement by them, and what is told of either."""
    lever = data.lever.clone()
    lever[:, :, DIRECTIONS - 1] = 0.0
    columns = [k for k in ALL if k not in OF_MECHANICS]
    return replace(told(data, columns), load=torch.zeros_like(data.load), lever=lever)


class UnguidedTask(ForceTask):
    """Learned without mechanics, but in loads of the same size. There is no load beside which a correction could be
    too large to be believed."""

    def __init__(self, scale: Tensor, *parts: Any) -> None:
        super().__init__(*parts)
        self._scale = scale

    def fresh_model(self, seed: int) -> ForceModel:
        """See `ForceTask`."""
        model = super().fresh_model(seed)
        model.traction_scale.copy_(self._scale)
        model.trust = Confidence(len(model.local_mean))
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
    contact_centric_options = force_model_options(spec, context.experiment.contact.stiffness)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        lessons = Lessons(truth, body, context)
        collider = truth.contacts["collider"][truth.samples["contact"]]
        known = truth.header.colliders
        testing = [known.index(name) for name in names("test") if name in known]
        of_testing = np.flatnonzero(truth.usable & np.isin(collider, testing))
        chosen = (lessons.split.train[:: options.every], lessons.held_out, of_testing[:: options.every])
        data = [lessons.load_data(spec, contact_centric_options, samples) for samples in chosen]
        metric = lessons.metric(spec)
    print(f"{len(data[0])} samples to learn from, {len(data[1])} and {len(data[2])} to judge by\n")
    print("| inputs | their number | validation shapes | testing shapes | CPU s |")
    print("| --- | --- | --- | --- | --- |", flush=True)
    scale = (
        ForceTask(contact_centric_options, metric, data[0], data[1], body.n_rows)
        .fresh_model(0)
        .traction_scale
    )
    for name in (*VARIANTS, UNGUIDED):
        started = time.process_time()
        if name == UNGUIDED:
            make, (learned, *judged) = partial(UnguidedTask, scale), map(unguided, data)
        else:
            make, (learned, *judged) = ForceTask, (told(part, VARIANTS[name]) for part in data)
        tasks = [make(contact_centric_options, metric, learned, side, body.n_rows) for side in judged]
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
    main()
