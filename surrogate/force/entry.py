"""Registry entry for training learned contact forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from softprint.runtime.arrays import IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.forked_workers import ForkedWorkers
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.learned.force.entry import options
from softprint.runtime.learned.force.model import ForceModelOptions
from softprint.runtime.learned.internal.file import load_internal
from softprint.runtime.learned.internal_correction import internal_correction
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.scenes.corrected_body import internal_path
from softprint.runtime.truth.shared_samples import in_order, shares_of, workers_for
from softprint.surrogate.data.folds import folds_of
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.force.crossed import CrossedForceTask
from softprint.surrogate.force.data import ForceData, join_force_data, read_force_data
from softprint.surrogate.force.energy import ContactMaker, energy_of
from softprint.surrogate.force.kept_energy import Learned, kept_energy
from softprint.surrogate.force.loss import ForceMetric
from softprint.surrogate.force.settling import LearnedSettling, learn_settling, told
from softprint.surrogate.force.task import ForceTask
from softprint.surrogate.form import TrainingForm


def task(data: TrainingData, spec: ModelSpec) -> ForceTask:
    """The training task of a [[training.models]] table, on training and validation samples. Contact has the energy of
    linear mechanics: a learned one, which hardly changes displacements, is learned from all samples."""
    own = options(spec, data.body, PenaltyContact.of(data.context.experiment.contact))
    training, validation = _read(data, spec, own, data.split.train, data.held_out)
    return ForceTask.of(own, metric(data, spec), training, validation, data.body.n_rows)


def crossed(data: TrainingData, spec: ModelSpec) -> CrossedForceTask:
    """The same on all samples."""
    own, notes = _options(data, spec)
    (whole,) = _read(data, spec, own, data.split.whole)
    folds = folds_of(data.truth, whole.sample.cpu().numpy(), data.context.seed)
    if not folds:
        raise SoftprintError(
            f"{data.truth.path}: its {len(whole)} samples are of one contact, and learning needs two at least: one to "
            "learn from, and one to judge by. `sampling.states` and `sampling.places` say how many there are"
        )
    joints = settling(data, spec)
    learned = None if joints is None else joints.settling
    return CrossedForceTask(own, metric(data, spec), whole, folds, data.body.n_rows, notes, learned)


def _options(data: TrainingData, spec: ModelSpec) -> tuple[ForceModelOptions, dict[str, Any]]:
    """With the energy that was learned, and notes about it."""
    own = options(spec, data.body, PenaltyContact.of(data.context.experiment.contact))
    joints, notes = settling(data, spec), dict[str, Any]()
    if joints is not None:
        notes["settling"] = {name: value for name, value in joints._asdict().items() if name != "settling"}
        if joints.settling is not None:
            own = replace(own, settling=joints.settling.sizes)
    learned = _energy(data, spec, own) if spec.learned else None
    if learned is None:
        return own, notes
    energy, errors = learned
    notes["energy"] = errors._asdict()
    return replace(own, energy=() if energy is None else energy.values), notes


def metric(data: TrainingData, spec: ModelSpec) -> ForceMetric:
    """The error norm; one for each number of contact nodes."""
    return data.once(
        ("force metric", spec.contact_nodes),
        lambda: ForceMetric(data.body, mechanics(data, spec), data.spec.edge_weight),
    )


def mechanics(data: TrainingData, spec: ModelSpec) -> BodyMechanics:
    """The body mechanics with the options of a [[training.models]] table, and what is learned of joints."""
    _, found = data.mechanics.get(spec.contact_nodes)
    if not spec.static_condensation:
        return found._replace(condensation=None)
    learned = settling(data, spec)
    if found.condensation is None or learned is None or learned.settling is None:
        return found
    return found._replace(condensation=replace(found.condensation, settling=learned.settling))


def settling(data: TrainingData, spec: ModelSpec) -> LearnedSettling | None:
    """How joints settle, learned from the states of all samples that may be learned from; None for a model that learns
    nothing, or is added to an internal correction, and where nothing can be learned."""
    if not spec.learned or not spec.static_condensation or spec.added_to:
        return None

    def learn() -> LearnedSettling | None:
        _, found = data.mechanics.get(spec.contact_nodes)
        if found.condensation is None:
            return None
        states = np.unique(data.truth.sample_state[data.split.whole])
        learned = learn_settling(data.body, found.condensation, data.truth, states)
        if learned is not None:
            data.context.say(told(learned))
        return learned

    return data.once(("settling", spec.contact_nodes), learn)


def internal_below(data: TrainingData, spec: ModelSpec) -> InternalField | None:
    """The internal correction that the model is added to, from the run directory; None for none."""
    if not spec.added_to:
        return None
    path, gravity = (
        internal_path(data.context.out_dir, spec.added_to),
        data.context.experiment.dynamics.gravity,
    )
    return data.once(
        ("internal", spec.added_to),
        lambda: internal_correction(load_internal(path, data.body), data.body, gravity),
    )


def force_data(
    data: TrainingData,
    spec: ModelSpec,
    options: ForceModelOptions,
    samples: IntArray,
    progress: Callable[[int], None] | None = None,
) -> ForceData:
    """Some rows of the truth file, with any mix of colliders. Raises SoftprintError if none of them touches the reduced
    body."""

    def work(share: IntArray, progress: Callable[[int], None]) -> list[tuple[NDArray[Any], ...]]:
        return [part.arrays for part in _touching(data, spec, options, share, progress)]

    # Before workers are forked, which share them.
    metric(data, spec)
    data.build_colliders(samples)
    count = workers_for(data.truth, samples)
    with ForkedWorkers(work, count) as workers:
        found = workers.map(shares_of(data.truth, samples, count), progress)
    touching = [ForceData.of_arrays(part) for parts in found for part in parts]
    if not touching:
        raise SoftprintError(
            f"{data.truth.path}: in none of the {len(samples)} requested samples does a collider touch the reduced body"
        )
    joined = join_force_data(touching)
    return joined.take(torch.from_numpy(in_order(data.truth, joined.sample.numpy())))


def _touching(
    data: TrainingData,
    spec: ModelSpec,
    options: ForceModelOptions,
    samples: IntArray,
    progress: Callable[[int], None],
) -> list[ForceData]:
    """Collider by collider, of those that touch the reduced body."""
    own, measured_in, internal = mechanics(data, spec), metric(data, spec), internal_below(data, spec)
    parts = [
        read_force_data(data.truth, data.body, collider, own, options, measured_in, part, progress, internal)
        for collider, part in data.by_collider(samples)
    ]
    return [part for part in parts if part is not None]


def contact_maker(data: TrainingData, spec: ModelSpec, options: ForceModelOptions) -> ContactMaker:
    """Makes the contact of the body with a collider, under an energy."""
    own, internal = mechanics(data, spec), internal_below(data, spec)

    def contact_of(collider: Collider, learned: LearnedEnergy) -> ContactStateProbe:
        return ContactStateProbe(data.body, collider, own, options.law, options.band, learned, internal)

    return contact_of


def _energy(data: TrainingData, spec: ModelSpec, options: ForceModelOptions) -> Learned:
    """The energy of contact, learned once for all networks on the same mechanics."""
    key = ("energy", spec.contact_nodes, spec.static_condensation, spec.added_to, options.band, options.law)

    def learn() -> Learned:
        return energy_of(data, contact_maker(data, spec, options))

    return data.once(key, lambda: kept_energy(data, spec, options, learn))


def _read(
    data: TrainingData, spec: ModelSpec, options: ForceModelOptions, *parts: IntArray
) -> tuple[ForceData, ...]:
    """The data of some rows of the truth file each; networks on the same mechanics share them."""
    metric(data, spec)  # before the progress bar below, because it may show its own

    def read() -> tuple[ForceData, ...]:
        with data.context.progress(sum(map(len, parts)), "sample", "reading contact forces") as bar:
            return tuple(
                force_data(data, spec, options, samples, bar.update).to(data.device) for samples in parts
            )

    own = (
        spec.contact_nodes,
        spec.static_condensation,
        spec.added_to,
        options.band,
        options.law,
        options.energy,
        options.settling,
    )
    return data.once(("force", own, *(part.tobytes() for part in parts)), read)


TRAINING = TrainingForm(settings=lambda training: training, task=task, crossed=crossed)
