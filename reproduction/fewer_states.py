"""How many states of the body a correction has to learn from: tables 5.2 and 5.3 of the thesis.

    softprint generate examples/worm_small.toml --set sampling.states=8 --out runs/worm_states
    python -m reproduction.fewer_states examples/worm_small.toml --set sampling.states=8 --out runs/worm_states \\
        --states 1 3 7

    softprint generate examples/jelly3d_small.toml --set sampling.states=26 --set sampling.places=4 \\
        --set sampling.rotations=3 --out runs/jelly_states
    python -m reproduction.fewer_states examples/jelly3d_small.toml --set sampling.states=26 --out runs/jelly_states \\
        --set sampling.places=4 --set sampling.rotations=3 --states 5 25 --models object-centric sparse mechanics ours

The last state is held out, with contacts of its own; models learn from the first 1, 3, ... of the others. Models:

    object-centric    the method of chapter 4 (form `thesis4`)
    sparse, dense     the contact-centric network of chapter 5, with weighted handle rows (eq. 5.4), and with all rows
                      without weights (eq. 5.3)
    mechanics, ours   linear mechanics, and what is learned on top of it

Printed is the error of the displacement by contact on the held-out state, sqrt(sum |u - u*|^2 / sum |u*|^2), a table in
Markdown. Displacement fields are judged in the world, contact forces in rest coordinates.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from reproduction.ablation import trained as train_variant
from reproduction.object_centric import OBJECT_CENTRIC, Recipe, learned, on_samples
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.registry import TRAININGS, training_settings

MECHANICS, OURS = "mechanics", "ours"
FIELDS = {"sparse": "weighted_rows", "dense": "all_rows"}
MODELS = (OBJECT_CENTRIC, *FIELDS, MECHANICS, OURS)


def spec_of(model: str, neurons: Sequence[int]) -> ModelSpec:
    """The [[training.models]] table that a model stands for."""
    if model not in FIELDS:
        return ModelSpec(name=model)
    table = {"encoding": FIELDS[model], "hidden": tuple(neurons), "activation": "tanh", "fade_depth": 2e-3}
    return ModelSpec.model_validate({"name": model, "form": "thesis5", **table})


def error(data: TrainingData, model: str, neurons: Sequence[int]) -> float:
    """On the held-out state, of a model trained on the data."""
    if model == OBJECT_CENTRIC:
        own = learned(data, data.split.train, Recipe(neurons, 100, 4000, "contact"))
        return on_samples(data.truth, own.displacement, data.held_out, "contact")
    spec, experiment = spec_of(model, neurons), data.context.experiment
    task = TRAININGS[spec.form].task(data, spec)
    if model == MECHANICS:
        return float(task.held_out_error(task.fresh_model(0)).rms)
    settings = training_settings(experiment.training, spec.form, experiment.seed)
    return train_variant(model, task, settings).error.rms


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory with truth.h5 (default: runs/NAME)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as of the truth")
    parser.add_argument("--states", type=int, nargs="+", required=True, help="learn from so many states")
    parser.add_argument("--models", nargs="+", choices=MODELS, default=["sparse", "dense", MECHANICS, OURS])
    parser.add_argument(
        "--neurons", type=int, nargs="+", default=[150, 150], help="of networks (default: 150 150)"
    )
    given = parser.parse_args()
    context = Context(experiment_path=given.experiment, overrides=tuple(given.set), out=given.out, quiet=True)
    try:
        body = body_of_run(context)
        with load_truth(context.out_dir / "truth.h5", body) as truth:
            most = len(truth.states) - context.experiment.training.validation_states
            if max(given.states) > most or min(given.states) < 1:
                raise SoftprintError(f"--states: the truth has {most} states to learn from")
            print(
                "| model | "
                + " | ".join(map(str, given.states))
                + " |\n"
                + "| --- " * (1 + len(given.states))
                + "|"
            )
            for model in given.models:
                cells = []
                for count in given.states:
                    data = TrainingData(truth, body, context)
                    first = data.split.train[truth.sample_state[data.split.train] < count]
                    data.split = replace(data.split, train=np.asarray(first))
                    cells.append(f"{error(data, model, given.neurons):.1%}")
                print(f"| {model} | {' | '.join(cells)} |", flush=True)
    except SoftprintError as problem:
        parser.error(str(problem))


if __name__ == "__main__":
    run_script(main)
