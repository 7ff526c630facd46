"""How each kind of learned correction is trained: `TRAINING` of `NAME/entry.py`, for every NAME of
`runtime/learned/registry.py`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from softprint.runtime.experiment.schema.training import TrainingSpec
from softprint.runtime.learned.registry import FORMS
from softprint.surrogate.form import TrainingForm
from softprint.surrogate.train import TrainingSettings

TRAININGS: Mapping[str, TrainingForm[Any]] = {
    name: import_module(f"softprint.surrogate.{name}.entry").TRAINING for name in FORMS
}


def training_settings(spec: TrainingSpec, form: str, seed: int) -> TrainingSettings:
    """The settings in a [training] table for models of one form."""
    table = TRAININGS[form].settings(spec)
    return TrainingSettings(
        steps=table.steps,
        batch=table.batch,
        learning_rate=table.learning_rate,
        weight_decay=table.weight_decay,
        validations=table.validations,
        seed=seed,
    )
