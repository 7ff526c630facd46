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
from softprint.surrogate.internal.slope_data import read_slope_data
from softprint.surrogate.internal.slope_task import SlopeTask
from softprint.surrogate.internal.slopes import EquilibriumSlopes
from softprint.surrogate.internal.task import InternalTask
from softprint.surrogate.train import ProgressUpdate, TrainingResult, TrainingSettings, train

SETTINGS = TrainingSettings(
    steps=8000, batch=64, learning_rate=6e-3, weight_decay=1e-4, validations=20, seed=0
)


def train_internal(
    truth: TruthData,
    body: ReducedBody,
    condensation: StaticCondensation | None = None,
    widths: tuple[int, ...] = (200, 200),
    components: int = 100,
    linear: bool = True,
    settings: TrainingSettings = SETTINGS,
    progress: ProgressUpdate | None = None,
    derivatives: bool = True,
) -> TrainingResult[InternalModel]:
    """An internal correction learned from all states of a truth file. condensation: of all nodes of the body, for a
    correction that adds to it; widths: neurons of each hidden layer; components: of the principal ones; linear: whether
    a linear part is fitted before the network is trained; derivatives: whether it is also trained on the derivatives of
    the equilibria (`slopes.py`). The thesis has widths (100, 100), 15 components, no linear part and no derivatives
    (table 4.1). Raises SoftprintError as `read_internal_data` and for more components than there are."""
    data = read_internal_data(truth, body, condensation, settings.seed)
    options = InternalOptions(widths, components, linear, condensation is not None, data.gravity)
    if not derivatives:
        return train(InternalTask(options, data, body.n_rows), settings, progress=progress)
    slopes = EquilibriumSlopes(body, condensation)
    learned = read_slope_data(truth, body, data, slopes, components, settings.seed)
    return train(SlopeTask(options, data, learned, body.n_rows), settings, progress=progress)
