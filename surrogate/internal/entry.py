"""Trains the internal correction of a body, from Python.

with load_truth("runs/accordion_small/truth.h5", body) as truth:
    result = train_internal(truth, body, mechanics.condensation)
correction = InternalCorrection(result.model, body)
"""

from __future__ import annotations

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.learned.internal.model import InternalModel, InternalOptions
from softprint.runtime.mechanics.static_condensation import StaticCondensation
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.internal.data import read_internal_data
from softprint.surrogate.internal.task import InternalTask
from softprint.surrogate.train import ProgressUpdate, TrainingResult, TrainingSettings, train

SETTINGS = TrainingSettings(
    steps=6000, batch=128, learning_rate=3e-3, weight_decay=1e-4, validations=20, seed=0
)


def train_internal(
    truth: TruthData,
    body: ReducedBody,
    condensation: StaticCondensation | None = None,
    widths: tuple[int, ...] = (100, 100),
    components: int = 60,
    linear: bool = True,
    settings: TrainingSettings = SETTINGS,
    progress: ProgressUpdate | None = None,
) -> TrainingResult[InternalModel]:
    """An internal correction learned from all states of a truth file. condensation: of all nodes of the body, for a
    correction that adds to it; widths: neurons of each hidden layer; components: of the principal ones; linear: whether
    a linear part is fitted before the network is trained. The thesis has widths (100, 100), 15 components, and no
    linear part (table 4.1). Raises SoftprintError as `read_internal_data` and `principal_components`."""
    data = read_internal_data(truth, body, condensation, settings.seed)
    options = InternalOptions(widths, components, linear, condensation is not None, data.gravity)
    return train(InternalTask(options, data, body.n_rows), settings, progress=progress)
