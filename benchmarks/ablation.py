"""What makes a contact correction accurate? Variants trained on one truth file, with the same split and seed.

    python benchmarks/ablation.py examples/jelly3d_small.toml [--out RUN] [--steps 2500]
        [--field-steps 8500] [--only NAME ...]

Needs the truth file of the run (`softprint generate`). Prints a table in Markdown: the error on the held-out
states, sqrt(sum |u_pred - u|^2 / sum |u|^2) over volume and samples, its square, the worst sample, and the
time to train. 100 % is no correction at all. Fields are judged in the world, loads in rest coordinates,
which differ by the stretch of the states.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.colliders.build import build_collider
from runtime.experiment.training_schema import ModelSpec
from runtime.truth_file import load_truth
from surrogate.losses import FieldError
from surrogate.run_training import Lessons, training_settings
from surrogate.train import train

# Name in the table, and the [[training.models]] table it stands for.
VARIANTS: dict[str, ModelSpec] = {
    "thesis5": ModelSpec(name="x", form="field", hidden=(250, 250), activation="tanh", fade_depth=2e-3),
    "thesis5, fade over 0.5 mm": ModelSpec(name="x", form="field", hidden=(250, 250), activation="tanh"),
    "thesis5, displacement per depth": ModelSpec(
        name="x", form="field", hidden=(250, 250), activation="tanh", fade="proportional"
    ),
    "field, geometry of the contact": ModelSpec(
        name="x",
        form="field",
        hidden=(128, 128, 128),
        activation="silu",
        encoding="local_geometry",
        fade="proportional",
    ),
    "field, geometry and patch": ModelSpec(
        name="x",
        form="field",
        hidden=(128, 128, 128),
        activation="silu",
        encoding="local_geometry",
        fade="proportional",
        patch_inputs=True,
    ),
    "loads (ours)": ModelSpec(name="x"),
    "loads, tanh": ModelSpec(name="x", activation="tanh"),
    "loads, softplus": ModelSpec(name="x", activation="softplus"),
    "loads, 2 x 48 neurons": ModelSpec(name="x", hidden=(48, 48)),
    "loads, 2 x 192 neurons": ModelSpec(name="x", hidden=(192, 192)),
    "loads, at most 500": ModelSpec(name="x", loads=500),
}
UNTRAINED = "loads, nothing learned (linear compliance)"


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    error: FieldError
    parameters: int
    seconds: float

    def __str__(self) -> str:
        error = self.error
        return (
            f"| {self.name} | {error.rms:.1%} | {error.squared:.1%} | {error.worst:.0%} | "
            f"{self.parameters:,} | {self.seconds:.0f} |"
        )


def main() -> None:
    """Train every variant and print its line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory with truth.h5 (default: runs/NAME)")
    parser.add_argument("--steps", type=int, default=2500, help="optimiser steps of each variant of loads")
    parser.add_argument("--field-steps", type=int, default=8500, help="and of each field (smaller steps)")
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), help="these variants alone")
    options = parser.parse_args()
    overrides = (f"training.steps={options.steps}", f"training.field.steps={options.field_steps}")
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    experiment = context.experiment
    body = body_of_run(context)
    collider = build_collider(experiment.collider(experiment.training.collider), experiment.base_dir)
    settings = {
        form: training_settings(experiment.training, form, experiment.seed) for form in ("loads", "field")
    }
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        lessons = Lessons(truth, body, collider, experiment.training, context)
        print(
            f"{len(lessons.split.train)} samples to learn from, {len(lessons.held_out)} of held-out states, "
            f"label-noise floor {truth.noise_floor:.2%}\n"
        )
        print("| variant | held-out error | squared | worst sample | parameters | seconds |")
        print("| --- | --- | --- | --- | --- | --- |")
        for name, spec in VARIANTS.items():
            if options.only and name not in options.only:
                continue
            if spec.form == "field":
                task = lessons.field_task(spec)
                started = time.perf_counter()
                result = train(task, settings["field"])
                parameters = sum(p.numel() for p in result.model.parameters())
                print(Row(name, result.held_out, parameters, time.perf_counter() - started), flush=True)
            else:
                loads = lessons.load_task(spec, experiment.contact.stiffness)
                if name == "loads (ours)":
                    print(Row(UNTRAINED, loads.held_out_error(loads.fresh_model(0)), 0, 0.0), flush=True)
                started = time.perf_counter()
                trained = train(loads, settings["loads"])
                parameters = sum(p.numel() for p in trained.model.parameters())
                print(Row(name, trained.held_out, parameters, time.perf_counter() - started), flush=True)


if __name__ == "__main__":
    main()
