"""What makes a contact correction accurate? Variants trained on one truth file, with the same split and seed.

    python benchmarks/ablation.py examples/jelly3d_small.toml [--out RUN] [--steps 2500]
        [--field-steps 8500] [--only NAME ...] [--write]

Needs the truth file of the run (`softprint generate`). Prints a table in Markdown: the error on the held-out
states, sqrt(sum |u_pred - u|^2 / sum |u|^2) over volume and samples, its square, the worst sample, and the
time to train. 100 % is no correction at all. Fields are judged in the world, loads in rest coordinates,
which differ by the stretch of the states. With --write the table also goes to RUN/ablation.json, which
`softprint report` shows.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.experiment.training_schema import ModelSpec
from runtime.io.files import atomic_path
from runtime.truth.truth_file import load_truth
from surrogate.losses import FieldError
from surrogate.run_training import Lessons, training_settings
from surrogate.tasks import LearningTask, ModelT
from surrogate.train import TrainingSettings, train

GEOMETRY = ModelSpec(
    name="x",
    form="field",
    hidden=(128, 128, 128),
    activation="silu",
    encoding="local_geometry",
    fade="proportional",
)
# Name in the table, and the [[training.models]] table it stands for.
VARIANTS: dict[str, ModelSpec] = {
    "thesis5": ModelSpec(name="x", form="field", hidden=(250, 250), activation="tanh", fade_depth=2e-3),
    "thesis5, fade over 0.5 mm": ModelSpec(name="x", form="field", hidden=(250, 250), activation="tanh"),
    "thesis5, displacement per depth": ModelSpec(
        name="x", form="field", hidden=(250, 250), activation="tanh", fade="proportional"
    ),
    "field, geometry of the contact": GEOMETRY,
    "field, geometry and patch": GEOMETRY.model_copy(update={"patch_inputs": True}),
    "loads (ours)": ModelSpec(name="x"),
    "loads, tanh": ModelSpec(name="x", activation="tanh"),
    "loads, softplus": ModelSpec(name="x", activation="softplus"),
    "loads, 2 x 48 neurons": ModelSpec(name="x", hidden=(48, 48)),
    "loads, 2 x 192 neurons": ModelSpec(name="x", hidden=(192, 192)),
    "loads, at most 500 of them": ModelSpec(name="x", loads=500),
    "loads, on a body that does not settle inside": ModelSpec(name="x", internal=False),
}
UNTRAINED = "loads, nothing learned (linear elasticity)"


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

    def record(self) -> dict[str, str | float]:
        """The line for ablation.json; the report shows columns that are named errors in percent."""
        error = self.error
        return {
            "variant": self.name,
            "held_out_error": error.rms,
            "squared_error": error.squared,
            "worst_sample_error": error.worst,
            "parameters": self.parameters,
            "seconds": round(self.seconds, 1),
        }


def rows(lessons: Lessons, context: Context, names: Sequence[str]) -> Iterator[Row]:
    """Train the variants of these names, one after the other."""
    experiment = context.experiment
    for name in names:
        spec = VARIANTS[name]
        settings = training_settings(experiment.training, spec.form, experiment.seed)
        if spec.form == "field":
            yield trained(name, lessons.field_task(spec), settings)
            continue
        loads = lessons.load_task(spec, experiment.contact.stiffness)
        if name == "loads (ours)":
            yield Row(UNTRAINED, loads.held_out_error(loads.fresh_model(0)), 0, 0.0)
        yield trained(name, loads, settings)


def trained(name: str, task: LearningTask[ModelT], settings: TrainingSettings) -> Row:
    """Train one variant."""
    started = time.perf_counter()
    result = train(task, settings)
    parameters = sum(p.numel() for p in result.model.parameters())
    return Row(name, result.held_out, parameters, time.perf_counter() - started)


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
    parser.add_argument("--write", action="store_true", help="keep the table for the report (ablation.json)")
    options = parser.parse_args()
    overrides = (f"training.steps={options.steps}", f"training.field.steps={options.field_steps}")
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    body = body_of_run(context)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        lessons = Lessons(truth, body, context)
        print(
            f"{len(lessons.split.train)} samples to learn from, {len(lessons.held_out)} of held-out states, "
            f"label-noise floor {truth.noise_floor:.2%}\n"
        )
        print("| variant | held-out error | squared | worst sample | parameters | seconds |")
        print("| --- | --- | --- | --- | --- | --- |")
        records = []
        for row in rows(lessons, context, [name for name in VARIANTS if name in (options.only or VARIANTS)]):
            print(row, flush=True)
            records.append(row.record())
            if options.write:  # after every line: a long table that is stopped leaves what it has
                with atomic_path(context.out_dir / "ablation.json") as path:
                    path.write_text(json.dumps({"rows": records}, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
