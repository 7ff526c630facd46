"""Registry entry for training object-centric corrections."""

from __future__ import annotations

from softprint.runtime.arrays import IntArray
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.thesis4.entry import options
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.form import TrainingForm
from softprint.surrogate.thesis4.data import ObjectCentricData, common_shape, read_object_centric
from softprint.surrogate.thesis4.task import ObjectCentricTask


def task(data: TrainingData, spec: ModelSpec) -> ObjectCentricTask:
    """The training task of a [[training.models]] table."""
    law = PenaltyContact.of(data.context.experiment.contact)
    architecture = options(spec, data.body, law)
    colliders = common_shape([own for own, _ in data.by_collider(data.split.train)], spec.parameters)
    training, validation = data.once(("thesis4", spec.target, spec.parameters), lambda: _read(data, spec))
    return ObjectCentricTask(
        architecture,
        training,
        validation,
        data.body.mesh.node_volumes,
        data.body.n_rows,
        colliders,
        data.spec.thesis4.input_gain,
        data.device,
    )


def _read(data: TrainingData, spec: ModelSpec) -> tuple[ObjectCentricData, ObjectCentricData]:
    """Training and validation data, shared by all models with this target and these parameters."""
    train, held_out = data.split.train, data.held_out
    with data.context.progress(len(train) + len(held_out), "sample", "reading displacements") as bar:

        def read(samples: IntArray) -> ObjectCentricData:
            return read_object_centric(
                data.truth, data.body, data.by_collider(samples), spec.target, spec.parameters, bar.update
            )

        return read(train), read(held_out)


TRAINING = TrainingForm(settings=lambda training: training.thesis4, task=task)
