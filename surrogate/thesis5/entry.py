"""Registry entry for training contact-centric displacement fields."""

from __future__ import annotations

import numpy as np

from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.thesis5.entry import options
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.form import TrainingForm
from softprint.surrogate.thesis5.data import ContactDataset, PoolSize, load_dataset
from softprint.surrogate.thesis5.task import ContactCentricTask, InputGains


def task(data: TrainingData, spec: ModelSpec) -> ContactCentricTask:
    """The training task of a [[training.models]] table."""
    settings = data.spec.thesis5
    gains = InputGains(settings.input_gain, settings.position_gain)
    law = PenaltyContact.of(data.context.experiment.contact)
    training, validation = data.once("thesis5", lambda: _read(data))
    return ContactCentricTask(
        options(spec, data.body, law), training, validation, data.spec.edge_weight, gains
    )


def _read(data: TrainingData) -> tuple[ContactDataset, ContactDataset]:
    """Training and validation data, shared by all models."""
    settings, rng = data.spec.thesis5, np.random.default_rng(data.context.seed)
    size = PoolSize(settings.pools, settings.nodes, settings.edges)
    collider, train, held_out = data.build(data.collider), data.split.train, data.held_out
    with data.context.progress(len(train) + len(held_out), "sample", "reading displacements") as bar:
        training = load_dataset(data.truth, data.body, collider, train, size, rng, bar.update)
        validation = load_dataset(data.truth, data.body, collider, held_out, None, rng, bar.update)
    return training.to(data.device), validation.to(data.device)


TRAINING = TrainingForm(settings=lambda training: training.thesis5, task=task)
