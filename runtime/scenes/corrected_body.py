"""A body with an internal correction of its run directory, which corrections of contact are added to."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.experiment.experiment import CONDENSED
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.static_condensation import compute_static_condensation


def internal_path(out: Path, name: str) -> Path:
    """The file that `train` writes for the internal correction of that name."""
    return out / "internal" / f"{name}.safetensors"


class CorrectedBody(NamedTuple):
    """A body, with the cubature of its internal correction, the mechanics below that correction, and it."""

    body: ReducedBody
    mechanics: BodyMechanics | None = None
    internal: InternalField | None = None


def corrected_body(body: ReducedBody, path: Path, gravity: Array) -> CorrectedBody:
    """The body with the internal correction of a file; gravity: (dim,) [m/s^2]."""
    # Imported here, because torch takes a second to load and the other models do not need it.
    from softprint.runtime.learned.internal.file import load_internal
    from softprint.runtime.learned.internal_correction import internal_correction

    trained = load_internal(path, body)
    internal, own = internal_correction(trained, body, gravity), trained.on(body)
    mechanics = condensed_mechanics(own, gravity) if internal.on_condensation else None
    return CorrectedBody(own, mechanics, internal)


def body_below(body: ReducedBody, out: Path, name: str, gravity: Array) -> CorrectedBody:
    """The body that corrections of contact with `added_to` = name are added to: with static condensation, or with an
    internal correction of the run directory; gravity: (dim,) [m/s^2]."""
    if name == CONDENSED:
        return CorrectedBody(body, condensed_mechanics(body, gravity))
    return corrected_body(body, internal_path(out, name), gravity)


def condensed_mechanics(body: ReducedBody, gravity: Array) -> BodyMechanics:
    """Static condensation alone, without a compliance of the surface; gravity: (dim,) [m/s^2]."""
    return BodyMechanics(None, compute_static_condensation(body, gravity, NullSpaceCompliance(body)))
