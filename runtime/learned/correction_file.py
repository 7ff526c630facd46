"""Correction files: safetensors with a JSON header, never pickle.

The header says what the correction is (architecture, dimension), what it belongs to (hash of the body, name
of the collider, hash of the truth it was learned from) and how good it is on states it has never seen.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.errors import SoftprintError
from runtime.experiment.experiment import ANY_COLLIDER
from runtime.io.files import provenance
from runtime.io.tensor_file import load_tensors, save_tensors
from runtime.learned.force.correction import ForceCorrection
from runtime.learned.force.model import ForceModel, ForceModelOptions
from runtime.learned.thesis5.correction import ContactCentricCorrection
from runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from runtime.learned.thesis6.correction import DescriptorCorrection
from runtime.learned.thesis6.model import DescriptorModel, DescriptorModelOptions
from runtime.mechanics.body_mechanics import BodyMechanics
from runtime.mechanics.static_condensation import condensation_arrays, take_condensation
from runtime.mechanics.surface_compliance_tensors import surface_compliance_tensors, take_compliance

if TYPE_CHECKING:
    from torch import Tensor

KIND, VERSION = "correction", 8
REMEDY = "train it again"
# Forms: a `ContactCentricModel`, a `ForceModel` with its `BodyMechanics`, a `DescriptorModel`.
FIELD, LOADS, DESCRIPTOR = "field", "loads", "descriptor"
AnyCorrection = ContactCentricCorrection | ForceCorrection | DescriptorCorrection
_FORM_OF = {ContactCentricModel: FIELD, ForceModel: LOADS, DescriptorModel: DESCRIPTOR}


@dataclass(frozen=True)
class CorrectionHeader:
    """What a correction file says about itself.

    held_out_rms: relative error on the held-out states (see `surrogate.losses`); training: how it was
    trained, free form.
    """

    name: str
    collider: str
    body_hash: str
    truth_hash: str
    dim: int
    n_rows: int
    form: str
    options: dict[str, Any]
    held_out_rms: float
    training: dict[str, object]
    provenance: dict[str, str]


def save_correction(
    path: Path,
    name: str,
    model: ContactCentricModel | ForceModel | DescriptorModel,
    body: ReducedBody,
    collider: str,
    truth_hash: str,
    held_out_rms: float,
    training: Mapping[str, object],
    mechanics: BodyMechanics | None = None,
) -> None:
    """Write a trained model with what it belongs to; atomic. A load model comes with its body's mechanics."""
    header = CorrectionHeader(
        name=name,
        collider=collider,
        body_hash=body.content_hash,
        truth_hash=truth_hash,
        dim=model.dim,
        n_rows=model.n_rows,
        form=_FORM_OF[type(model)],
        options=model.options.to_json(),
        held_out_rms=held_out_rms,
        training=dict(training),
        provenance=provenance(),
    )
    text = json.dumps({field.name: getattr(header, field.name) for field in fields(header)})
    tensors = dict(model.state_dict())
    if mechanics is not None:
        tensors |= _mechanics_tensors(mechanics)
    save_tensors(path, KIND, VERSION, {"header": text}, tensors)


def as_saved(mechanics: BodyMechanics) -> BodyMechanics:
    """As it comes back from a file, where the compliance is in half precision: what learns with it learns with what the
    runtime will have, whether it was just worked out or is of an earlier file."""
    return _take_mechanics(_mechanics_tensors(mechanics))


def _mechanics_tensors(mechanics: BodyMechanics) -> dict[str, Tensor]:
    tensors = surface_compliance_tensors(mechanics.compliance)
    if mechanics.internal is not None:
        arrays = condensation_arrays(mechanics.internal)
        tensors |= {name: torch.from_numpy(array) for name, array in arrays.items()}
    return tensors


def _take_mechanics(tensors: dict[str, Tensor]) -> BodyMechanics:
    return BodyMechanics(take_compliance(tensors), take_condensation(tensors))


def read_header(path: Path) -> CorrectionHeader:
    """The header alone. Raises SoftprintError where the file is missing, damaged, foreign or of another
    version."""
    return _read(path)[0]


def load_correction(path: Path, body: ReducedBody, collider: Collider) -> AnyCorrection:
    """The correction of a file on a collider, the one that it was trained for if it is not for any.

    Raises SoftprintError as :func:`read_header` does, and where body or collider are not those of the file.
    """
    return read_correction(path, body).on(collider)


@dataclass(frozen=True, eq=False)
class TrainedCorrection:
    """A correction file, read once for any number of colliders. mechanics: of the body, for the form that has them."""

    path: Path
    header: CorrectionHeader
    mechanics: BodyMechanics | None
    _make: Callable[[Collider], AnyCorrection]

    def is_for(self, collider: str) -> bool:
        """Whether it was trained for the collider of that name, or for any."""
        return self.header.collider in (ANY_COLLIDER, collider)

    def on(self, collider: Collider) -> AnyCorrection:
        """The correction on one collider. Raises SoftprintError where it is not for that one."""
        if not self.is_for(collider.name):
            raise SoftprintError(
                f"{self.path}: was trained for the collider {self.header.collider!r}, not for {collider.name!r}"
            )
        return self._make(collider)


def read_correction(path: Path, body: ReducedBody) -> TrainedCorrection:
    """A correction of this body. Raises SoftprintError as :func:`read_header` does, and where it is of another body."""
    header, tensors = _read(path)
    if header.body_hash != body.content_hash:
        raise SoftprintError(
            f"{path}: was trained for another body (hash {header.body_hash[:12]}) than {body.name!r} "
            f"({body.content_hash[:12]}): train it again for this body"
        )
    try:
        mechanics = None
        if header.form == LOADS:
            mechanics = _take_mechanics(tensors)
        make = _maker(header, tensors, mechanics, body)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise SoftprintError(
            f"{path}: weights and header do not fit together ({error}): train it again"
        ) from error
    return TrainedCorrection(path, header, mechanics, make)


def _maker(
    header: CorrectionHeader, tensors: dict[str, Tensor], mechanics: BodyMechanics | None, body: ReducedBody
) -> Callable[[Collider], AnyCorrection]:
    if header.form == FIELD:
        field_model = ContactCentricModel(
            ContactCentricOptions.from_json(header.options), header.dim, header.n_rows
        )
        field_model.load_state_dict(tensors)
        return lambda collider: ContactCentricCorrection(header.name, field_model, body, collider)
    if header.form == DESCRIPTOR:
        options = DescriptorModelOptions.from_json(header.options)
        descriptor_model = DescriptorModel(options, header.dim, header.n_rows)
        descriptor_model.load_state_dict(tensors)
        return lambda collider: DescriptorCorrection(header.name, descriptor_model, body, collider)
    if mechanics is None:
        raise ValueError(f"form {header.form!r} is not known")
    load_model = ForceModel(ForceModelOptions.from_json(header.options), header.dim, header.n_rows)
    load_model.load_state_dict(tensors)
    return lambda collider: ForceCorrection(header.name, load_model, body, collider, mechanics)


def _read(path: Path) -> tuple[CorrectionHeader, dict[str, Tensor]]:
    texts, tensors = load_tensors(path, KIND, VERSION, REMEDY)
    try:
        return CorrectionHeader(**json.loads(texts["header"])), tensors
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise SoftprintError(f"{path}: the header is incomplete ({error}): train it again") from error
