"""How one kind of learned correction is trained: the interface shared by `thesis5`, `thesis6` and `force`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol

from softprint.runtime.experiment.schema.training import ModelSpec, TrainingSpec
from softprint.runtime.learned.form import ModelT
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.learning_task import CrossedTask, LearningTask


class SettingsTable(Protocol):
    """An experiment table with optimiser settings, see `TrainingSettings`."""

    @property
    def steps(self) -> int: ...
    @property
    def batch(self) -> int: ...
    @property
    def learning_rate(self) -> float: ...
    @property
    def weight_decay(self) -> float: ...
    @property
    def validations(self) -> int: ...


@dataclass(frozen=True)
class TrainingForm(Generic[ModelT]):
    """settings: selects the table with the settings of this kind; task: reads the data for a [[training.models]] table
    and builds its training task."""

    settings: Callable[[TrainingSpec], SettingsTable]
    task: Callable[[TrainingData, ModelSpec], LearningTask[ModelT]]
    crossed: Callable[[TrainingData, ModelSpec], CrossedTask[ModelT]] | None = None
