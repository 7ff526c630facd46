"""A body's mechanics at rest that an earlier training has left in its correction, so as not to be worked out again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from runtime.body.body import ReducedBody
from runtime.errors import SoftprintError
from runtime.learned.correction_file import read_correction
from runtime.mechanics.body_mechanics import BodyMechanics


def kept_mechanics(
    paths: Iterable[Path], body: ReducedBody, loads: int, gravity: Sequence[float]
) -> BodyMechanics | None:
    """Of this body with at most so many loads, internal response under gravity [m/s^2] included; None where no
    correction file has it. Files that cannot be read are passed over: they will be written anew."""
    for path in paths:
        try:
            trained = read_correction(path, body)
        except SoftprintError:
            continue
        model, mechanics = trained.header.training.get("model"), trained.mechanics
        if (
            mechanics is not None
            and mechanics.internal is not None
            and isinstance(model, dict)
            and model.get("loads") == loads
            and trained.header.training.get("gravity") == list(gravity)
        ):
            return mechanics
    return None
