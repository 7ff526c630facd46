"""The object-centric method of the thesis's chapter 4 (form `thesis4`) beside the models of a run: tables 4.2 and 5.2.

    softprint run examples/jelly2d_circle_small.toml
    python -m reproduction.object_centric examples/jelly2d_circle_small.toml --components 50 --widths 100 100

Needs the truth and the motions of the run. The method is trained on the usable samples of the truth: principal
components of r = F^-1 (x - U q), as functions of the collider's place relative to the handles; two tanh layers, Adam,
batches of 512 (eqs. 4.7 to 4.9, 4.3.3), without the fade that a simulation needs. Like the Jelly of table 4.1, it has
no internal correction: r is the whole of it. A table in Markdown, a line for each model:

    discarded     energy beyond the principal components
    training      error of r on the samples that the model has learned from, at the end of training
    random        on a tenth of the samples, drawn at random and not learned from: the thesis's test data (4.3.3);
                  sqrt(sum |x(model) - x|^2 / sum |U q - x|^2)
    state         the same on the samples of the held-out states
    held-out      the same over the nodes and the frames in contact of the test scenes, at the full-space motion's state

The other models are the corrections of the run, with their internal displacement. --samples: learn from so many.
--each-layer: a model for each of these numbers of neurons, which both layers have.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from softprint.fem_truth.report.measurements.held_out import Comparer, HeldOutMotion
from softprint.fem_truth.report.run_files import RunFiles, find_run_files, judged_scenes, load_motions
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.intrusion import pierced_from
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment
from softprint.runtime.experiment.experiment import FULL
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.learned.internal.correction import mapped, unmapped
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.learned.thesis4.entry import options
from softprint.runtime.learned.thesis4.inputs import InteractionState
from softprint.runtime.truth.truth_file import TruthData, load_truth
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.thesis4.data import ObjectCentricData, common_shape
from softprint.surrogate.thesis4.task import ObjectCentricTask
from softprint.surrogate.train import TrainingSettings, train

OBJECT_CENTRIC = "object-centric"
# The thesis has no fade: this one ends far before the depth of one that all samples are given [m].
NO_FADE = 1e-9
# Parameters of a collider of one size.
NOTHING = np.empty(0)
# One in so many samples is drawn for the column `random`.
RANDOM = 10
# x - U q (n_nodes, dim) [m] at handle rows and a pose of the collider.
Displacement = Callable[[Array, RigidPose], Array]


@dataclass(frozen=True)
class Recipe:
    """How the method is trained; target: see `ModelSpec`."""

    widths: Sequence[int]
    components: int
    steps: int
    target: Literal["contact", "whole"] = "whole"
    learning_rate: float = 1e-2
    input_gain: float = 4.0

    @property
    def settings(self) -> TrainingSettings:
        """Batches of the thesis, with a learning rate that falls."""
        return TrainingSettings(self.steps, 512, self.learning_rate, 0.0, 10, 0)


class Learned(NamedTuple):
    """displacement: what the model adds to U q; discarded: energy beyond the components; training: error of r on the
    samples it was trained on, relative."""

    displacement: Displacement
    discarded: float
    training: float


def read(data: TrainingData, samples: IntArray, recipe: Recipe) -> ObjectCentricData:
    """What the method learns from samples of a truth; also from those where the reduced body has left the collider,
    because nothing fades out."""
    truth, body = data.truth, data.body
    state, gradient = InteractionState.of(body), basis_gradient_at_nodes(body)
    inputs, fields = [], []
    for sample in map(int, samples):
        rows = np.asarray(truth.states["rows"][truth.sample_state[sample]])
        inputs.append(state.seen(truth.pose(sample), NOTHING)(rows))
        field = unmapped(gradient, rows, exact(truth, sample, recipe.target))
        fields.append(field.astype(np.float32))
    return ObjectCentricData(np.array(inputs), np.ones(len(samples)), np.array(fields), np.asarray(samples))


def learned(data: TrainingData, samples: IntArray, recipe: Recipe) -> Learned:
    """The method, learned from samples of a truth; the weights are those with the lowest error on `data.held_out`."""
    return fitted(data, read(data, samples, recipe), read(data, data.held_out, recipe), recipe)


def fitted(
    data: TrainingData, training: ObjectCentricData, validation: ObjectCentricData, recipe: Recipe
) -> Learned:
    """`learned`, of what was read before."""
    body, samples = data.body, training.sample
    table = {
        "name": OBJECT_CENTRIC,
        "form": "thesis4",
        "hidden": tuple(recipe.widths),
        "components": min(recipe.components, len(samples) - 1),
        "target": recipe.target,
        "fade_depth": NO_FADE,
    }
    architecture = options(ModelSpec.model_validate(table), body, PenaltyContact(1.0))
    colliders = [collider for collider, _ in data.by_collider(samples)]
    task = ObjectCentricTask(
        architecture,
        training,
        validation,
        body.mesh.node_volumes,
        body.n_rows,
        common_shape(colliders, ()),
        recipe.input_gain,
    )
    result = train(task, recipe.settings)
    network, modes = result.model.as_arrays(), result.model.modes.double().numpy()
    state, gradient = InteractionState.of(body), basis_gradient_at_nodes(body)

    def displacement(rows: Array, pose: RigidPose) -> Array:
        value = network.value(state.seen(pose, NOTHING)(rows))
        return mapped(gradient, rows, np.einsum("k,knd->nd", value, modes))

    left = float(np.sqrt(result.history[-1]["loss"] + task.targets.discarded))
    return Learned(displacement, task.targets.discarded, left)


def exact(truth: TruthData, sample: int, target: str = "whole") -> Array:
    """What a model has to add in a sample (n_nodes, dim) [m]: x - U q, or what contact alone adds."""
    u = truth.displacement(sample).astype(float)
    return u + truth.internal(int(truth.sample_state[sample])) if target == "whole" else u


def on_samples(truth: TruthData, model: Displacement, samples: IntArray, target: str = "whole") -> float:
    """The columns `random` and `state`."""
    missed = size = 0.0
    for sample in map(int, samples):
        rows, wanted = truth.states["rows"][truth.sample_state[sample]], exact(truth, sample, target)
        missed += np.square(model(rows, truth.pose(sample)) - wanted).sum()
        size += np.square(wanted).sum()
    return float(np.sqrt(missed / size)) if size else float("nan")


def on_motions(
    experiment: Experiment, files: RunFiles, body: ReducedBody, models: Mapping[str, Displacement]
) -> dict[str, dict[str, float]]:
    """The column `held-out`: by scene and model, those given and the corrections of the run."""
    found = {}
    for scene in judged_scenes(experiment):
        full = load_motions(files, experiment, scene, body)[FULL]
        collider = build_collider(experiment.collider(scene.colliders[0].name), experiment.base_dir)
        motion = HeldOutMotion(
            full.times, full.colliders[collider.name].poses, full.in_contact, full.positions
        )
        corrections = {
            name: StaticCorrection(load_correction(path, body, collider), body)
            for name, path in files.corrections.items()
        }
        comparer = Comparer(body, collider, motion, corrections)
        contact, _ = comparer.contact_frames()
        contact = contact[~full.invalid(pierced_from(body.mesh))[contact]]
        comparer.begin()
        missed = dict.fromkeys(["bare", *corrections, *models], 0.0)
        for frame in map(int, contact):
            positions, rows = comparer.positions(frame), comparer.rows(frame)
            for name, model in models.items():
                positions[name] = positions["bare"] + model(rows, motion.poses[frame])
            for name in missed:
                missed[name] += np.square(positions[name] - positions[FULL]).sum()
        found[scene.name] = {name: float(np.sqrt(value / missed["bare"])) for name, value in missed.items()}
    return found


def arguments(description: str | None) -> argparse.ArgumentParser:
    """The options that scripts with this method share."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as of the run")
    parser.add_argument(
        "--widths", type=int, nargs="+", default=[250, 250], help="neurons (default: 250 250)"
    )
    parser.add_argument("--components", type=int, default=100, help="principal ones (default: 100)")
    parser.add_argument("--steps", type=int, default=4000, help="of the optimiser (default: 4000)")
    return parser


def context_of(given: argparse.Namespace) -> Context:
    """The run that the options name."""
    return Context(experiment_path=given.experiment, overrides=tuple(given.set), out=given.out, quiet=True)


def truth_path(files: RunFiles, context: Context) -> Path:
    """The truth of a run. Raises SoftprintError without one."""
    if files.truth is None:
        raise SoftprintError(
            f"{context.out_dir}: has no truth.h5: softprint generate {context.experiment_path}"
        )
    return files.truth


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument(
        "--samples", type=int, nargs="+", help="to learn from, one model for each number (default: all)"
    )
    parser.add_argument(
        "--each-layer", type=int, nargs="+", help="neurons of both layers, one model for each number"
    )
    given = parser.parse_args()
    context = context_of(given)
    experiment = context.experiment
    try:
        files, body = find_run_files(context.out_dir, experiment), body_of_run(context)
        networks = [[width, width] for width in given.each_layer or ()] or [given.widths]
        recipes = [Recipe(widths, given.components, given.steps) for widths in networks]
        lines: dict[str, list[str]] = {}
        models: dict[str, Displacement] = {}
        with load_truth(truth_path(files, context), body) as truth:
            data = TrainingData(truth, body, context)
            order = np.random.default_rng(0).permutation(data.split.train)
            drawn, order = np.sort(order[::RANDOM]), np.delete(order, np.s_[::RANDOM])
            training, validation = (read(data, own, recipes[0]) for own in (order, data.held_out))
            for count, recipe in product(given.samples or [len(order)], recipes):
                model = fitted(data, training.some(order[:count]), validation, recipe)
                name = f"{OBJECT_CENTRIC}, {min(count, len(order)):,} samples, {'+'.join(map(str, recipe.widths))}"
                models[name] = model.displacement
                errors = [on_samples(truth, model.displacement, own) for own in (drawn, data.held_out)]
                lines[name] = [f"{model.discarded:.1e}", *(f"{own:.1%}" for own in (model.training, *errors))]
                print(name, *lines[name], file=sys.stderr)
        motions = on_motions(experiment, files, body, models)
    except SoftprintError as error:
        parser.error(str(error))
    print(
        "| model | discarded | training | random | state | "
        + " | ".join(motions)
        + " |\n"
        + "| --- " * (5 + len(motions))
        + "|"
    )
    for name in next(iter(motions.values())):
        first = lines.get(name, [""] * 4)
        print(f"| {name} | {' | '.join([*first, *(f'{own[name]:.1%}' for own in motions.values())])} |")


if __name__ == "__main__":
    run_script(main)
