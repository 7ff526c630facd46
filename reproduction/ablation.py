"""What makes a contact correction accurate? Variants trained on one truth file, with the same split and seed.

    python -m reproduction.ablation examples/jelly3d_small.toml [--out RUN] [--steps 2500]
        [--thesis5-steps 8500] [--only NAME ...] [--write]

Needs the truth file of the run (`softprint generate`). Prints a table in Markdown: the error on the held-out
states, sqrt(sum |u_pred - u|^2 / sum |u|^2) over volume and samples, its square, the worst sample, and the
time to train. 100 % is no correction at all. Displacement fields are judged in the world, contact forces in
rest coordinates, which differ by the stretch of the states. With --write the table also goes to
RUN/ablation.json, which `softprint report` shows.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.io.files import atomic_path
from softprint.runtime.learned.form import ModelT
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.learning_task import HeldOutError, LearningTask
from softprint.surrogate.registry import TRAININGS, training_settings
from softprint.surrogate.train import TrainingSettings, train

GEOMETRY = ModelSpec(
    name="x",
    form="thesis5",
    hidden=(128, 128, 128),
    activation="silu",
    encoding="local_geometry",
    fade="proportional",
)
OURS = "force (ours)"
# Name in the table, and the [[training.models]] table it stands for.
VARIANTS: dict[str, ModelSpec] = {
    "thesis5": ModelSpec(name="x", form="thesis5", hidden=(250, 250), activation="tanh", fade_depth=2e-3),
    "thesis5, fade over 0.5 mm": ModelSpec(name="x", form="thesis5", hidden=(250, 250), activation="tanh"),
    "thesis5, displacement per depth": ModelSpec(
        name="x", form="thesis5", hidden=(250, 250), activation="tanh", fade="proportional"
    ),
    "thesis5, geometry of the contact": GEOMETRY,
    "thesis5, geometry and patch": GEOMETRY.model_copy(update={"patch_inputs": True}),
    OURS: ModelSpec(name="x"),
    "force, tanh": ModelSpec(name="x", activation="tanh"),
    "force, softplus": ModelSpec(name="x", activation="softplus"),
    "force, 2 x 48 neurons": ModelSpec(name="x", hidden=(48, 48)),
    "force, 2 x 192 neurons": ModelSpec(name="x", hidden=(192, 192)),
    "force, at most 500 contact nodes": ModelSpec(name="x", contact_nodes=500),
    "force, no static condensation": ModelSpec(name="x", static_condensation=False),
}
UNTRAINED = "force, nothing learned (linear mechanics)"


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    error: HeldOutError
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


def rows(data: TrainingData, context: Context, names: Sequence[str]) -> Iterator[Row]:
    """Train the variants of these names, one after the other."""
    experiment = context.experiment
    for name in names:
        spec = VARIANTS[name]
        settings = training_settings(experiment.training, spec.form, experiment.seed)
        task = TRAININGS[spec.form].task(data, spec)
        if name == OURS:
            yield Row(UNTRAINED, task.held_out_error(task.fresh_model(0)), 0, 0.0)
        yield trained(name, task, settings)


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
    parser.add_argument(
        "--steps", type=int, default=2500, help="optimiser steps of each variant of form force"
    )
    parser.add_argument("--thesis5-steps", type=int, default=8500, help="and of form thesis5 (smaller steps)")
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), help="these variants alone")
    parser.add_argument("--write", action="store_true", help="keep the table for the report (ablation.json)")
    options = parser.parse_args()
    overrides = (f"training.steps={options.steps}", f"training.thesis5.steps={options.thesis5_steps}")
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    body = body_of_run(context)
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        data = TrainingData(truth, body, context)
        print(
            f"{len(data.split.train)} samples to learn from, {len(data.held_out)} of held-out states, "
            f"label-noise floor {truth.noise_floor:.2%}\n"
        )
        print("| variant | held-out error | squared | worst sample | parameters | seconds |")
        print("| --- | --- | --- | --- | --- | --- |")
        records = []
        for row in rows(data, context, [name for name in VARIANTS if name in (options.only or VARIANTS)]):
            print(row, flush=True)
            records.append(row.record())
            if options.write:  # after every line: a long table that is stopped leaves what it has
                with atomic_path(context.out_dir / "ablation.json") as path:
                    path.write_text(json.dumps({"rows": records}, indent=1), encoding="utf-8")


if __name__ == "__main__":
    run_script(main)
