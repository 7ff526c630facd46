"""A body with an internal correction of its run directory, which corrections of contact act on."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import CONDENSED
from softprint.runtime.learned.correction import ContactCorrection, Correction
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
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
    """The body that corrections of contact act on: with static condensation, with the internal correction of that name
    of the run directory, or as it is for an empty name; gravity: (dim,) [m/s^2]."""
    if not name:
        return CorrectedBody(body)
    if name == CONDENSED:
        return CorrectedBody(body, condensed_mechanics(body, gravity))
    return corrected_body(body, internal_path(out, name), gravity)


def on_corrected_body(correction: Correction, own: CorrectedBody) -> Correction:
    """A correction of contact as it acts on a body with an internal correction that its training did not have: without
    static condensation, where that settles the body. Raises SoftprintError for a displacement field, which has learned
    what the body lacked in its training."""
    if not isinstance(correction, ContactCorrection):
        raise SoftprintError(
            f"correction {correction.name!r} is a displacement field, and acts on the body of its training only: give "
            "it `added_to` in its [[training.models]] and train it again"
        )
    if own.internal is None or own.internal.on_condensation:
        return correction
    return correction.without_condensation()


def condensed_mechanics(body: ReducedBody, gravity: Array) -> BodyMechanics:
    """Static condensation alone, without a compliance of the surface; gravity: (dim,) [m/s^2]."""
    condensation = compute_static_condensation(body, gravity, NullSpaceCompliance(body))
    return BodyMechanics(None, condensation, body_hash=body.content_hash)
