"""How far the forces of a truth depend on where a shape lies between the nodes of the body, and models beside that.

    python -m benchmarks.force_floor examples/jelly_library_small.toml [--out RUN] [--samples 24] [--models ours]

Some contacts of shapes never seen, drawn at random from those in which mechanics is off by less than half, are solved
again in full space, with the shape moved along the surface to OFFSETS places, up to one distance between nodes to
either side, from shallow to deep as a sample is. As the shape and its depth stay, forces on handles, the force on the
collider and the energy change smoothly, and a cubic polynomial of the offset has all of that. What is left is the
scatter of the truth: of the facets that the contact meets, which no model can know from the shape. Models are compared
at the same places:

    scatter  = sqrt(sum |true - its cubic|^2 / d / (sum |true|^2 / n)),    d of n offsets are left by the cubic
    error    = sqrt(sum |found - true|^2 / sum |true|^2)
    smooth   = the same of the cubic of found - true: the error but for the scatter

over all contacts and offsets, and mechanics is always among the models.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.dynamics.handle_forces import HandleCoordinates
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.entry import options as force_options
from softprint.runtime.scenes.playing import correction_path
from softprint.runtime.scenes.scene import held_frames
from softprint.runtime.shapes import names
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.force.energy import ContactMaker, contacts_of, with_forces
from softprint.surrogate.force.entry import contact_maker, mechanics
from softprint.surrogate.force.sampled_contacts import LABELS, SampledContacts

MECHANICS = LearnedEnergy.of_mechanics()
OFFSETS, DEGREE = 13, 3
HEADS = {"handles": "force on the handles", "collider": "force on the collider", "energy": "energy"}

# By kind of label, (n_offsets, n_k).
Labels = Mapping[str, Array]


class Slides:
    """Contacts of a truth, moved along the surface."""

    def __init__(self, data: TrainingData, contact_of: ContactMaker, law: PenaltyContact) -> None:
        context, body = data.context, data.body
        self._truth, self._body = data.truth, body
        self._problem = ConstrainedProblem(
            FullSpaceElasticity(body), np.array(context.experiment.dynamics.gravity), law, body
        )
        self._contact_of = contact_of
        self._handles = HandleCoordinates(body, held_frames(context.experiment))

    def paths(self, sample: int, rng: np.random.Generator) -> list[list[RigidPose]]:
        """Approaches at every offset, along some direction across that of the approach."""
        path = self._truth.approach_path(sample)
        approach = self._truth.contacts["direction"][self._truth.samples["contact"][sample]]
        across = rng.normal(size=self._body.dim)
        across -= approach * (approach @ across)
        across /= np.linalg.norm(across)
        reach = self._body.mesh.surface_spacing
        return [
            [RigidPose(pose.rotation, pose.translation + offset * across) for pose in path]
            for offset in np.linspace(-reach, reach, OFFSETS)
        ]

    def true(self, sample: int, collider: Collider, path: Sequence[RigidPose]) -> Labels | None:
        """None where a solve does not converge."""
        truth, state = self._truth, self._truth.sample_state[sample]
        rows = truth.states["rows"][state]
        internal = self._body.reduced_positions(rows) + truth.internal(state)
        press = self._problem.press(rows, collider, internal)
        for pose in path:
            found = press.solve(pose)
            if not found.converged:
                return None
        force = found.handle_force - truth.states["handle_force"][state]
        return self._labels(rows, force, found.energy - truth.states["energy"][state])

    def found(
        self, sample: int, collider: Collider, path: Sequence[RigidPose], learned: LearnedEnergy
    ) -> Labels | None:
        """Of condensed contact; None where a solve does not converge."""
        rows = self._truth.states["rows"][self._truth.sample_state[sample]]
        probe, solved = self._contact_of(collider, learned), None
        for pose in path:
            solved = probe.solve(rows, pose, solved)
        if solved is None or not solved.solution.converged:
            return None
        evaluation = probe.evaluation(solved)
        return self._labels(rows, evaluation.gradient, evaluation.energy)

    def _labels(self, rows: Array, force: Array, energy: float) -> Labels:
        on_collider = self._body.handles.affine_part @ force
        handles = self._handles.along(rows, force)
        return {"handles": handles, "collider": on_collider, "energy": np.array([energy])}


def cubic(values: Array) -> Array:
    """The polynomial of DEGREE over the offsets (n_offsets, n_k) that is nearest to values, there."""
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, OFFSETS), DEGREE)
    return np.asarray(basis @ np.linalg.lstsq(basis, values, rcond=None)[0])


def figures(true: Sequence[Array], found: Sequence[Array]) -> tuple[float, float, float]:
    """Scatter, error and smooth error of one kind of label, by contact (n_offsets, n_k)."""
    size = sum(float(np.square(one).sum()) for one in true)
    left = sum(float(np.square(one - cubic(one)).sum()) for one in true)
    off = [b - a for a, b in zip(true, found, strict=True)]
    error = sum(float(np.square(one).sum()) for one in off)
    smooth = sum(float(np.square(cubic(one)).sum()) for one in off)
    scatter = left * OFFSETS / (OFFSETS - DEGREE - 1)
    return np.sqrt(scatter / size), np.sqrt(error / size), np.sqrt(smooth / size)


def drawn(data: TrainingData, contacts: SampledContacts, most: int) -> IntArray:
    """Some comparable samples (n,) of shapes kept for testing, see `Sampled`, at random."""
    truth = data.truth
    name = np.array(truth.header.colliders)[truth.contacts["collider"][truth.samples["contact"]]]
    unseen = with_forces(data, np.flatnonzero(truth.usable & np.isin(name, names("test"))))
    some = np.random.default_rng(data.context.seed).permutation(unseen)[: 2 * most]
    comparable = contacts.at(np.sort(some), MECHANICS, lambda _: None).comparable
    return np.sort(some[np.isin(some, comparable)][:most])


def energies(
    data: TrainingData, spec: ModelSpec, models: Sequence[str]
) -> Iterator[tuple[str, LearnedEnergy]]:
    """Of mechanics, and of trained models."""
    yield "mechanics", MECHANICS
    collider, _ = next(data.by_collider(data.split.train[:1]))
    for name in models:
        path = correction_path(data.context.out_dir, name)
        correction = load_correction(path, data.body, collider, mechanics(data, spec))
        learned = correction.model.options.learned if isinstance(correction, ForceCorrection) else None
        if learned is None:
            raise SoftprintError(f"{path}: has the energy of mechanics, so that there is nothing to compare")
        yield name, learned


def main(words: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, help="of a library, whose truth is made")
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--samples", type=int, default=24, help="contacts, drawn at random")
    parser.add_argument("--models", nargs="*", default=[], metavar="NAME", help="trained, beside mechanics")
    given = parser.parse_args(words)
    context = Context(experiment_path=given.experiment, out=given.out, quiet=True)
    body, spec = body_of_run(context), ModelSpec(name="ours")
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        data = TrainingData(truth, body, context)
        law = PenaltyContact.of(context.experiment.contact)
        contact_of = contact_maker(data, spec, force_options(spec, body, law))
        samples = drawn(data, contacts_of(data, contact_of), given.samples)
        models = dict(energies(data, spec, given.models))
        slides = Slides(data, contact_of, law)
        compared, failed = dict[str, list[list[Labels]]](true=[], **{name: [] for name in models}), 0
        for collider, part in data.by_collider(samples):
            for sample in map(int, part):
                paths = slides.paths(sample, np.random.default_rng(sample))
                columns: list[list[Labels | None]] = [[slides.true(sample, collider, path) for path in paths]]
                columns += [
                    [slides.found(sample, collider, path, learned) for path in paths]
                    for learned in models.values()
                ]
                if any(one is None for column in columns for one in column):
                    failed += 1
                    continue
                for kept, column in zip(compared.values(), columns, strict=True):
                    kept.append([one for one in column if one is not None])
    print(
        f"{len(compared['true'])} contacts at {OFFSETS} places; {failed} with a solve that did not converge"
    )
    print("| | " + " | ".join(f"{HEADS[kind]}: scatter, error, smooth" for kind in LABELS) + " |")
    print("| --- " * (1 + len(LABELS)) + "|")
    for name in models:
        cells = []
        for kind in LABELS:
            true, found = (
                [np.stack([at[kind] for at in one]) for one in compared[which]] for which in ("true", name)
            )
            cells.append(", ".join(f"{100.0 * value:.1f}" for value in figures(true, found)))
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    run_script(main)
