"""The contact-centric displacement field as a kind of correction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.form import LearnedForm
from softprint.runtime.learned.thesis5.correction import ContactCentricCorrection
from softprint.runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


def options(spec: ModelSpec, body: ReducedBody, law: PenaltyContact) -> ContactCentricOptions:
    """The architecture that a [[training.models]] table asks for."""
    return ContactCentricOptions(
        encoding=spec.encoding,
        patch_inputs=spec.patch_inputs,
        widths=spec.hidden,
        activation=spec.activation,
        fade=spec.fade,
        fade_depth=spec.fade_depth,
        added_to=spec.added_to,
    )


def model(values: Mapping[str, Any], dim: int, n_rows: int) -> ContactCentricModel:
    """An untrained model with the options of a header."""
    return ContactCentricModel(ContactCentricOptions.from_json(values), dim, n_rows)


def correction(
    name: str,
    model: ContactCentricModel,
    body: ReducedBody,
    collider: Collider,
    mechanics: BodyMechanics | None,
) -> ContactCentricCorrection:
    """The correction for one collider."""
    return ContactCentricCorrection(name, model, body, collider)


FORM = LearnedForm(
    name=ContactCentricModel.form,
    line="displacement field of one collider (thesis, chapter 5)",
    needs_mechanics=False,
    options=options,
    model=model,
    correction=correction,
)
