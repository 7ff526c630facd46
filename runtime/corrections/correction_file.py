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
from runtime.corrections.compliance_tensors import compliance_tensors, take_compliance
from runtime.corrections.contact_centric import ContactCentric
from runtime.corrections.descriptor_contact import DescriptorContact
from runtime.corrections.descriptor_model import DescriptorModel, DescriptorModelOptions
from runtime.corrections.elastic_contact import ElasticContact
from runtime.corrections.internal_response import internal_arrays, take_internal
from runtime.corrections.load_model import LoadModel, LoadModelOptions
from runtime.corrections.model import ContactModel, ModelOptions
from runtime.corrections.rest_mechanics import RestMechanics
from runtime.errors import SoftprintError
from runtime.experiment.experiment import ANY_COLLIDER
from runtime.files import provenance
from runtime.tensor_file import load_tensors, save_tensors

if TYPE_CHECKING:
    from torch import Tensor

KIND, VERSION = "correction", 8
REMEDY = "train it again"
# Forms: a `ContactModel`, a `LoadModel` with its `RestMechanics`, a `DescriptorModel`.
FIELD, LOADS, DESCRIPTOR = "field", "loads", "descriptor"
AnyCorrection = ContactCentric | ElasticContact | DescriptorContact
_FORM_OF = {ContactModel: FIELD, LoadModel: LOADS, DescriptorModel: DESCRIPTOR}


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
    model: ContactModel | LoadModel | DescriptorModel,
    body: ReducedBody,
    collider: str,
    truth_hash: str,
    held_out_rms: float,
    training: Mapping[str, object],
    mechanics: RestMechanics | None = None,
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


def as_saved(mechanics: RestMechanics) -> RestMechanics:
    """As it comes back from a file, where the compliance is in half precision: what learns with it learns with what the
    runtime will have, whether it was just worked out or is of an earlier file."""
    return _take_mechanics(_mechanics_tensors(mechanics))


def _mechanics_tensors(mechanics: RestMechanics) -> dict[str, Tensor]:
    tensors = compliance_tensors(mechanics.compliance)
    if mechanics.internal is not None:
        arrays = internal_arrays(mechanics.internal)
        tensors |= {name: torch.from_numpy(array) for name, array in arrays.items()}
    return tensors


def _take_mechanics(tensors: dict[str, Tensor]) -> RestMechanics:
    return RestMechanics(take_compliance(tensors), take_internal(tensors))


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
    mechanics: RestMechanics | None
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
    header: CorrectionHeader, tensors: dict[str, Tensor], mechanics: RestMechanics | None, body: ReducedBody
) -> Callable[[Collider], AnyCorrection]:
    if header.form == FIELD:
        field_model = ContactModel(ModelOptions.from_json(header.options), header.dim, header.n_rows)
        field_model.load_state_dict(tensors)
        return lambda collider: ContactCentric(header.name, field_model, body, collider)
    if header.form == DESCRIPTOR:
        options = DescriptorModelOptions.from_json(header.options)
        descriptor_model = DescriptorModel(options, header.dim, header.n_rows)
        descriptor_model.load_state_dict(tensors)
        return lambda collider: DescriptorContact(header.name, descriptor_model, body, collider)
    if mechanics is None:
        raise ValueError(f"form {header.form!r} is not known")
    load_model = LoadModel(LoadModelOptions.from_json(header.options), header.dim, header.n_rows)
    load_model.load_state_dict(tensors)
    return lambda collider: ElasticContact(header.name, load_model, body, collider, mechanics)


def _read(path: Path) -> tuple[CorrectionHeader, dict[str, Tensor]]:
    texts, tensors = load_tensors(path, KIND, VERSION, REMEDY)
    try:
        return CorrectionHeader(**json.loads(texts["header"])), tensors
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise SoftprintError(f"{path}: the header is incomplete ({error}): train it again") from error
