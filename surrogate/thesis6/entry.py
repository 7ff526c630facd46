"""Registry entry for training displacement fields from local descriptors."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import IntArray
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.thesis6.entry import options
from softprint.runtime.learned.thesis6.model import DescriptorModelOptions
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.form import TrainingForm
from softprint.surrogate.thesis6.data import (
    DescriptorData,
    Drawing,
    join_descriptor_data,
    load_descriptor_data,
)
from softprint.surrogate.thesis6.loss import DescriptorLoss
from softprint.surrogate.thesis6.task import DescriptorTask


def task(data: TrainingData, spec: ModelSpec) -> DescriptorTask:
    """The training task of a [[training.models]] table."""
    own, settings = (
        options(spec, data.body, PenaltyContact.of(data.context.experiment.contact)),
        data.spec.thesis6,
    )
    training = descriptors(data, own, data.split.train, drawing(data))
    validation = descriptors(data, own, data.held_out, None)
    return DescriptorTask(
        own, DescriptorLoss(settings.consistency, settings.input_gain), training, validation
    )


def drawing(data: TrainingData) -> Drawing:
    """How points of interest are drawn for training."""
    settings = data.spec.thesis6
    return Drawing(settings.points, settings.frames, np.random.default_rng(data.context.seed))


def descriptors(
    data: TrainingData, options: DescriptorModelOptions, samples: IntArray, drawing: Drawing | None
) -> DescriptorData:
    """Some rows of the truth file, with any mix of colliders; see `load_descriptor_data`."""
    with data.context.progress(len(samples), "sample", "computing descriptors") as bar:
        parts = [
            load_descriptor_data(data.truth, data.body, collider, options, part, drawing, bar.update)
            for collider, part in data.by_collider(samples)
        ]
    return join_descriptor_data(parts).to(data.device)


TRAINING = TrainingForm(settings=lambda training: training.thesis6, task=task)
