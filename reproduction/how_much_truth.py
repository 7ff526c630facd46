"""How much truth to buy? Error on shapes never seen, against the contacts and the shapes that were learned from.

    python -m reproduction.how_much_truth examples/jelly_library_small.toml [--out RUN] [--steps 2500] [--seeds 1]
        [--plot FILE.png]

Needs the truth of a library (`softprint generate`). Trains `ours` from the first contacts of every training shape, and
from all contacts of the first shapes of every other family, with the same settings each time, and prints a table in
Markdown: the relative error over the volume of the contact displacement, sqrt(sum |u - u*|^2 / sum |u*|^2), and its
square, on validation shapes and on testing shapes: means over several seeds of training, and how far these are apart
on testing shapes. Nothing is chosen here but the best weights of a run, by the validation shapes. The table also goes
to RUN/bench_how_much_truth.json, which `softprint report` shows.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from softprint.fem_truth.report.drawing.data_plot import DATA, data_figure
from softprint.runtime.arrays import BoolArray, IntArray
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.io.files import atomic_path
from softprint.runtime.learned.force.entry import options as force_options
from softprint.runtime.shapes import names
from softprint.runtime.truth.truth_file import TruthData, load_truth
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.force.data import ForceData, join_force_data
from softprint.surrogate.force.entry import force_data, metric
from softprint.surrogate.force.task import ForceTask
from softprint.surrogate.registry import training_settings
from softprint.surrogate.train import train


@dataclass(frozen=True)
class Row:
    """What was learned from, and the errors; contacts: of a shape in a state; testing_spread: between seeds, highest
    minus lowest; seconds: CPU time of one training."""

    shapes: int
    contacts: int
    samples: int
    validation_error: float
    testing_error: float
    testing_spread: float
    testing_squared: float
    seconds: float


class Parts:
    """The training data in parts that can be put together: parts[shape][k] is the k-th contact of a shape, in every
    state that is learned from."""

    def __init__(self, data: TrainingData, spec: ModelSpec) -> None:
        self.options = force_options(spec, data.body, PenaltyContact.of(data.context.experiment.contact))
        truth, train_rows = data.truth, data.split.train
        testing = np.flatnonzero(truth.usable & _of_shapes(truth, names("test")))
        self.metric = metric(data, spec)
        self.validation = force_data(data, spec, self.options, data.held_out)
        self.testing = force_data(data, spec, self.options, testing)
        number = truth.contacts["collider"][truth.samples["contact"]]
        self.by_shape: dict[str, list[ForceData]] = {}
        for shape in np.unique(number[train_rows]):
            rows = train_rows[number[train_rows] == shape]
            order = _order_of_contacts(truth, rows)
            self.by_shape[truth.header.colliders[shape]] = [
                force_data(data, spec, self.options, rows[order == k]) for k in range(order.max() + 1)
            ]

    def some(self, shapes: Sequence[str], contacts: int) -> ForceData:
        """The first contacts of some shapes."""
        return join_force_data([part for shape in shapes for part in self.by_shape[shape][:contacts]])


def _of_shapes(truth: TruthData, shapes: Sequence[str]) -> BoolArray:
    numbers = [truth.header.colliders.index(name) for name in shapes if name in truth.header.colliders]
    return np.asarray(np.isin(truth.contacts["collider"][truth.samples["contact"]], numbers))


def _order_of_contacts(truth: TruthData, rows: IntArray) -> IntArray:
    """For each sample the number of its contact among those of its state, in the order of work."""
    contact, state = truth.samples["contact"][rows], truth.sample_state[rows]
    order = np.empty(len(rows), dtype=np.int64)
    for one in np.unique(state):
        here = state == one
        order[here] = np.unique(contact[here], return_inverse=True)[1]
    return order


def rows(parts: Parts, context: Context, spec: ModelSpec, n_rows: int, seeds: int) -> Iterator[Row]:
    """Fewer contacts first, then fewer shapes."""
    # Every so manieth shape: families stand together in the catalogue.
    shapes = list(parts.by_shape)
    most = min(len(own) for own in parts.by_shape.values())
    for contacts in _halvings(most):
        yield _trained(parts, context, spec, n_rows, shapes, contacts, seeds)
    for count in _halvings(len(shapes))[:-1]:
        few = [shapes[round(k)] for k in np.linspace(0, len(shapes) - 1, count)]
        yield _trained(parts, context, spec, n_rows, few, most, seeds)


def _halvings(count: int) -> list[int]:
    """1, 2, 4, ... below `count`, and `count`."""
    return [2**k for k in range(20) if 2**k < count] + [count]


def _trained(
    parts: Parts,
    context: Context,
    spec: ModelSpec,
    n_rows: int,
    shapes: Sequence[str],
    contacts: int,
    seeds: int,
) -> Row:
    data = parts.some(shapes, contacts)
    settings = training_settings(context.experiment.training, spec.form, context.seed)
    task = ForceTask.of(parts.options, parts.metric, data, parts.validation, n_rows)
    on_testing = ForceTask.of(parts.options, parts.metric, data, parts.testing, n_rows)
    validation, testing = np.zeros(seeds), np.zeros(seeds)
    started = time.process_time()
    for k in range(seeds):
        result = train(task, replace(settings, seed=context.seed + k))
        validation[k] = result.held_out.rms
        testing[k] = on_testing.held_out_error(result.model).rms
    return Row(
        len(shapes),
        contacts,
        len(data),
        float(validation.mean()),
        float(testing.mean()),
        float(np.ptp(testing)),
        float(np.square(testing).mean()),
        round((time.process_time() - started) / seeds, 1),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--steps", type=int, default=2500, help="optimiser steps each time")
    parser.add_argument("--seeds", type=int, default=1, help="trainings of each row")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the table too")
    options = parser.parse_args()
    overrides = (f"training.steps={options.steps}",)
    context = Context(experiment_path=options.experiment, overrides=overrides, out=options.out, quiet=True)
    body, spec = body_of_run(context), ModelSpec(name="ours")
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        data = TrainingData(truth, body, context)
        parts = Parts(data, spec)
        untrained = ForceTask.of(
            parts.options, parts.metric, parts.some(list(parts.by_shape)[:1], 1), parts.testing, body.n_rows
        )
        error = untrained.held_out_error(untrained.fresh_model(0))
        print(f"nothing learned (mechanics): {error.rms:.2%} (squared {error.squared:.2%}) on testing shapes")
        print(f"label-noise floor {truth.noise_floor:.2%}\n")
        columns = list(Row.__dataclass_fields__)
        print(f"| {' | '.join(column.replace('_', ' ') for column in columns)} |")
        print("| " + " | ".join("---" for _ in columns) + " |")
        found = []
        for row in rows(parts, context, spec, body.n_rows, options.seeds):
            found.append(row)
            shown = [
                f"{value:.2%}" if key.startswith(("validation", "testing")) else f"{value:g}"
                for key, value in asdict(row).items()
            ]
            print(f"| {' | '.join(shown)} |", flush=True)
    with atomic_path(context.out_dir / DATA) as temporary:
        temporary.write_text(json.dumps({"rows": [asdict(row) for row in found]}, indent=1))
    if options.plot:
        data_figure([asdict(row) for row in found]).savefig(options.plot, dpi=140)


if __name__ == "__main__":
    run_script(main)
