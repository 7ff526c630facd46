"""What is learned apart, and in which coordinates: figures 4.2, 4.3 and 4.6 of the thesis.

    softprint run examples/accordion_small.toml
    python -m reproduction.disentangled examples/accordion_small.toml --widths 100 100 --tables without

Needs the truth and the motions of the run. Networks of the same size learn from the same data; two tables in Markdown.
Without contact (figures 4.2 and 4.3), from the internal equilibria of the states, judged at the states of full space in
the test scenes:

    local     r = F^-1 (x - U q), mapped to the world by F, of the handle rows without the rigid motion of the body
    global    x - U q, a displacement in the world, of the handle rows as they are
    all       x, without a subspace, of the same

In contact, at the state of full space in the test scenes:

    local, global, all     the same of x in contact, as functions of the collider's place relative to the handles, and
                           the last two of the handle rows too
    apart, together        figure 4.6: r_int(q) + r_ext(A(q)^-1 z), learned one after the other, and one network of the
                           neurons and components of both for the sum

Errors are sqrt(sum |x(model) - x|^2 / sum |U q - x|^2) over nodes and states or frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reproduction.object_centric import (
    Displacement,
    Recipe,
    arguments,
    context_of,
    exact,
    on_motions,
    truth_path,
)
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.report.run_files import RunFiles, find_run_files, judged_scenes, load_motions
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment
from softprint.runtime.experiment.experiment import FULL
from softprint.runtime.learned.internal.correction import mapped, unmapped
from softprint.runtime.learned.internal.inputs import RigidFreeRows
from softprint.runtime.learned.thesis4.inputs import InteractionState
from softprint.runtime.learned.thesis4.model import ObjectCentricOptions
from softprint.runtime.truth.truth_file import TruthData, load_truth
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.thesis4.data import ObjectCentricData, TrainedColliders
from softprint.surrogate.thesis4.task import ObjectCentricTask
from softprint.surrogate.train import train

# The thesis's learning rate, and torch's initial weights.
THESIS = Recipe((), 0, 4000, learning_rate=1e-3, input_gain=1.0)
# Neurons and components of an internal correction (table 4.1: 200 and 15).
INTERNAL = replace(THESIS, widths=(100, 100), components=15)
Read = Callable[[Array, RigidPose], Array]
TABLES = ("without", "contact")
# Internal equilibria are solved at one in so many frames.
EVERY = 4


@dataclass(frozen=True, eq=False)
class Mapping:
    """How a field that is learned becomes a displacement x - U q (n_nodes, dim) at handle rows, and back."""

    learned_from: Callable[[Array, Array], Array]
    displacement: Callable[[Array, Array], Array]


def mappings(body: ReducedBody) -> dict[str, Mapping]:
    """Local, global, and all."""
    gradient = basis_gradient_at_nodes(body)
    return {
        "local": Mapping(
            lambda rows, u: unmapped(gradient, rows, u), lambda rows, r: mapped(gradient, rows, r)
        ),
        "global": Mapping(lambda rows, u: u, lambda rows, r: r),
        "all": Mapping(
            lambda rows, u: body.reduced_positions(rows) + u, lambda rows, x: x - body.reduced_positions(rows)
        ),
    }


def fitted(
    body: ReducedBody, inputs: Array, fields: Array, train_on: IntArray, choose_by: IntArray, recipe: Recipe
) -> Callable[[Array], Array]:
    """Fields (s, n_nodes, dim) as functions of inputs (s, n_inputs), by principal components and a network; the weights
    are those with the lowest error on the rows `choose_by`."""
    flat = fields[train_on].reshape(len(train_on), -1)
    energy = np.linalg.eigvalsh(flat @ flat.T if len(flat) < flat.shape[1] else flat.T @ flat)
    # Beyond these there is nothing but round-off of single precision.
    components = min(recipe.components, int(np.count_nonzero(energy > 1e-10 * energy[-1])))
    options = ObjectCentricOptions(
        tuple(recipe.widths), components, inputs.shape[1], body.n_nodes, (), "whole", "saturating", 1e-9
    )
    parts = [
        ObjectCentricData(inputs[own], np.ones(len(own)), fields[own].astype(np.float32), own)
        for own in (train_on, choose_by)
    ]
    nothing = TrainedColliders(np.zeros(1), np.zeros(2))
    task = ObjectCentricTask(
        options, parts[0], parts[1], body.mesh.node_volumes, body.n_rows, nothing, recipe.input_gain
    )
    model = train(task, recipe.settings).model
    network, modes = model.as_arrays(), model.modes.double().numpy()
    return lambda z: np.einsum("k,knd->nd", network.value(z), modes)


@dataclass(frozen=True, eq=False)
class Samples:
    """rows (s, n_rows, dim), poses, and x - U q (s, n_nodes, dim) of samples, or of states without contact."""

    rows: Array
    poses: Sequence[RigidPose]
    u: Array

    def learn(
        self,
        body: ReducedBody,
        way: Mapping,
        read: Read,
        train_on: IntArray,
        choose_by: IntArray,
        recipe: Recipe,
    ) -> Displacement:
        """A model of x - U q."""
        inputs = np.array([read(*own) for own in zip(self.rows, self.poses, strict=True)])
        fields = np.array([way.learned_from(*own) for own in zip(self.rows, self.u, strict=True)])
        value = fitted(body, inputs, fields, train_on, choose_by, recipe)
        return lambda rows, pose: way.displacement(rows, value(read(rows, pose)))

    def error(self, model: Displacement, on: IntArray) -> float:
        """Of a model on some of them."""
        found = np.array([model(self.rows[k], self.poses[k]) for k in on])
        return float(np.sqrt(np.square(found - self.u[on]).sum() / np.square(self.u[on]).sum()))


def states_of(truth: TruthData, body: ReducedBody) -> Samples:
    """Those without contact."""
    rows = np.asarray(truth.states["rows"])
    u = np.array([truth.internal(state) for state in range(len(rows))])
    return Samples(rows, [RigidPose.identity(body.dim)] * len(rows), u)


def samples_of(truth: TruthData, samples: IntArray, target: str) -> Samples:
    """Those in contact."""
    rows = np.asarray(truth.states["rows"])[truth.sample_state[samples]]
    poses = [truth.pose(int(sample)) for sample in samples]
    return Samples(rows, poses, np.array([exact(truth, int(sample), target) for sample in samples]))


def frames_of(experiment: Experiment, files: RunFiles, body: ReducedBody) -> Samples:
    """Those of the test scenes, without contact: the internal equilibria at the states of full space."""
    problem = ConstrainedProblem(
        FullSpaceElasticity(body),
        np.array(experiment.dynamics.gravity),
        PenaltyContact.of(experiment.contact),
        body,
    )
    rows, u = [], []
    for scene in judged_scenes(experiment):
        full = load_motions(files, experiment, scene, body)[FULL]
        for frame in range(EVERY, full.n_frames, EVERY):
            own = body.project(full.positions(frame))
            solved = problem.internal_equilibrium(own)
            if solved.converged:
                rows.append(own)
                u.append(solved.x - body.reduced_positions(own))
    return Samples(np.array(rows), [RigidPose.identity(body.dim)] * len(rows), np.array(u))


def without_contact(truth: TruthData, body: ReducedBody, frames: Samples, recipe: Recipe) -> dict[str, float]:
    """The first table, by way."""
    states, ways, inner = states_of(truth, body), mappings(body), RigidFreeRows.of(body)
    choose_by = np.arange(0, len(states.rows), 10)
    train_on = np.setdiff1d(np.arange(len(states.rows)), choose_by)
    reads: dict[str, tuple[str, Read]] = {
        "local": ("local", lambda rows, pose: inner(rows)),
        "local, of all rows": ("local", lambda rows, pose: rows.ravel()),
        "global": ("global", lambda rows, pose: rows.ravel()),
        "all": ("all", lambda rows, pose: rows.ravel()),
    }
    found = {}
    for name, (way, read) in reads.items():
        model = states.learn(body, ways[way], read, train_on, choose_by, recipe)
        found[name] = frames.error(model, np.arange(len(frames.rows)))
    return found


def in_contact(truth: TruthData, data: TrainingData, recipe: Recipe) -> dict[str, Displacement]:
    """The models of the second table."""
    body, ways = data.body, mappings(data.body)
    samples = np.concatenate([data.split.train, data.held_out])
    train_on = np.arange(len(data.split.train))
    choose_by = np.arange(len(data.split.train), len(samples))
    place, inner = InteractionState.of(body), RigidFreeRows.of(body)

    def relative(rows: Array, pose: RigidPose) -> Array:
        return place.seen(pose, np.empty(0))(rows)

    def with_rows(rows: Array, pose: RigidPose) -> Array:
        return np.concatenate([relative(rows, pose), rows.ravel()])

    def with_state(rows: Array, pose: RigidPose) -> Array:
        return np.concatenate([relative(rows, pose), inner(rows)])

    whole, contact = (samples_of(truth, samples, target) for target in ("whole", "contact"))
    models = {
        name: whole.learn(body, way, relative if name == "local" else with_rows, train_on, choose_by, recipe)
        for name, way in ways.items()
    }
    local = ways["local"]
    states, own = states_of(truth, body), np.unique(truth.sample_state[data.split.train])
    choose = own[::10]
    internal = states.learn(
        body, local, lambda rows, pose: inner(rows), np.setdiff1d(own, choose), choose, INTERNAL
    )
    external = contact.learn(body, local, relative, train_on, choose_by, recipe)
    models["apart"] = lambda rows, pose: internal(rows, pose) + external(rows, pose)
    both = replace(
        recipe,
        widths=tuple(a + b for a, b in zip(recipe.widths, INTERNAL.widths, strict=True)),
        components=recipe.components + INTERNAL.components,
    )
    models["together"] = whole.learn(body, local, with_state, train_on, choose_by, both)
    return models


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument(
        "--tables", nargs="+", choices=TABLES, default=TABLES, help="some of them (default: both)"
    )
    parser.add_argument("--samples", type=int, help="to learn from in contact (default: all)")
    given = parser.parse_args()
    context = context_of(given)
    recipe = replace(THESIS, widths=given.widths, components=given.components, steps=given.steps)
    try:
        files, body = find_run_files(context.out_dir, context.experiment), body_of_run(context)
        with load_truth(truth_path(files, context), body) as truth:
            print(f"{len(truth.states)} states")
            if TABLES[0] in given.tables:
                frames = frames_of(context.experiment, files, body)
                print(f"\n| without contact, {len(frames.rows)} frames | error |\n| --- | --- |")
                small = replace(recipe, components=INTERNAL.components)
                for name, error in without_contact(truth, body, frames, small).items():
                    print(f"| {name} | {error:.1%} |", flush=True)
            if TABLES[1] not in given.tables:
                return
            data = TrainingData(truth, body, context)
            order = np.random.default_rng(0).permutation(data.split.train)
            data.split = replace(data.split, train=np.sort(order[: given.samples]))
            print(f"\n{len(data.split.train)} samples to learn from")
            models = in_contact(truth, data, recipe)
        motions = on_motions(context.experiment, files, body, models)
    except SoftprintError as error:
        parser.error(str(error))
    print("\n| in contact | " + " | ".join(motions) + " |\n" + "| --- " * (1 + len(motions)) + "|")
    for name in next(iter(motions.values())):
        print(f"| {name} | " + " | ".join(f"{own[name]:.1%}" for own in motions.values()) + " |")


if __name__ == "__main__":
    run_script(main)
