"""The internal correction of a trained file, with a network or of modes in elastic equilibrium."""

from __future__ import annotations

from collections.abc import Sequence

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.learned.internal.correction import InternalCorrection
from softprint.runtime.learned.internal.equilibrium.correction import EquilibriumCorrection
from softprint.runtime.learned.internal.file import TrainedInternal
from softprint.runtime.learned.internal.model import ModesModel


def internal_correction(
    trained: TrainedInternal, body: ReducedBody, gravity: Sequence[float] | Array | None = None
) -> InternalCorrection | EquilibriumCorrection:
    """The correction of a body. gravity: (dim,) [m/s^2] of the simulation, by default that of the training; amplitudes
    in equilibrium are found under it, on the cubature of the file."""
    if isinstance(trained.model, ModesModel):
        return EquilibriumCorrection(trained.model, trained.on(body), gravity)
    return InternalCorrection(trained.model, body)
