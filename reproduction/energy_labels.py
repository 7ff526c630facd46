"""What is each label of force worth to the learned energy? Learned from one after the other.

    python -m reproduction.energy_labels EXPERIMENT [--out RUN] [--samples 600] [--seeds 3]

Needs the truth of a library (`softprint generate`). Learned from displacement only, a correction has the energy of
linear mechanics; the other rows learn the energy (`surrogate/force/energy.py`) from the generalised contact force on
the handles, then also from the force on the collider, and from the energy itself. Whether an
energy is kept is decided by cross-validation, by the labels of the row. A table in Markdown: errors sqrt(sum |r|^2 /
sum |true|^2) of the three on shapes never seen, mean over the seeds, which draw other samples, and in brackets highest
minus lowest.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.force.entry import options as force_options
from softprint.runtime.shapes import names
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.data.folds import folds_of
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.force.energy import contacts_of, drawn, learn_energy, with_forces
from softprint.surrogate.force.entry import contact_maker
from softprint.surrogate.force.sampled_contacts import LABELS, SampledContacts

MECHANICS = LearnedEnergy.of_mechanics()
HEADS = {"handles": "force on the handles", "collider": "force on the collider", "energy": "energy"}
ROWS: dict[str, tuple[str, ...]] = {
    "and the force on the handles": ("handles",),
    "and the force on the collider": ("handles", "collider"),
    "and the energy: all labels": LABELS,
}


def ignore(count: int) -> None:
    """No progress is shown."""


def cells(found: Sequence[dict[str, float]]) -> list[str]:
    """Of the errors by seed."""
    each: list[Array] = [np.array([one[kind] for one in found]) for kind in LABELS]
    return [f"{e.mean():.1%}" + (f" ({np.ptp(e):.1%})" if len(e) > 1 else "") for e in each]


class Judge:
    """Errors on samples of shapes never seen that are comparable, see `Sampled`."""

    def __init__(self, contacts: SampledContacts, samples: IntArray) -> None:
        self._contacts, self._samples = contacts, samples
        mechanics = contacts.at(samples, MECHANICS, ignore)
        self._compared = mechanics.comparable
        self.of_mechanics = mechanics.errors(self._compared)

    def errors(self, learned: LearnedEnergy | None) -> dict[str, float]:
        """By label."""
        if learned is None:
            return self.of_mechanics
        return self._contacts.at(self._samples, learned, ignore).errors(self._compared)


def main() -> None:
    """Learn, judge, and print line by line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument(
        "--samples", type=int, default=600, help="to learn from, and of each side to judge by"
    )
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, out=options.out, quiet=True)
    body, spec = body_of_run(context), ModelSpec(name="ours")
    own = force_options(spec, body, PenaltyContact.of(context.experiment.contact))
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        data = TrainingData(truth, body, context)
        contacts = contacts_of(data, contact_maker(data, spec, own))
        name = np.array(truth.header.colliders)[truth.contacts["collider"][truth.samples["contact"]]]
        unseen = np.flatnonzero(truth.usable & np.isin(name, names("test")))
        judge = Judge(contacts, drawn(with_forces(data, unseen), context.seed, options.samples))
        print(f"| learned from | {' | '.join(HEADS[kind] for kind in LABELS)} | CPU s |")
        print("| --- " * (2 + len(LABELS)) + "|")
        print(f"| displacement only | {' | '.join(cells([judge.of_mechanics]))} | |", flush=True)
        for row, labels in ROWS.items():
            started, errors = time.process_time(), []
            for seed in range(options.seeds):
                samples = drawn(with_forces(data, data.split.whole), seed, options.samples)
                folds = folds_of(truth, samples, seed)
                learned, _ = learn_energy(contacts, samples, folds, ignore, labels)
                errors.append(judge.errors(learned))
            seconds = (time.process_time() - started) / options.seeds
            print(f"| {row} | {' | '.join(cells(errors))} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    run_script(main)
