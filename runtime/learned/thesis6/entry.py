"""The displacement field from local descriptors as a kind of correction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.form import LearnedForm
from softprint.runtime.learned.thesis6.correction import DescriptorCorrection
from softprint.runtime.learned.thesis6.descriptors import handle_spacing
from softprint.runtime.learned.thesis6.model import DescriptorModel, DescriptorModelOptions
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


def options(spec: ModelSpec, body: ReducedBody, law: PenaltyContact) -> DescriptorModelOptions:
    """The architecture that a [[training.models]] table asks for, with d the spacing of the handles."""
    return DescriptorModelOptions(
        widths=spec.hidden,
        activation=spec.activation,
        radius=handle_spacing(body),
        sets=spec.differences,
        samples=spec.samples,
        fade_depth=spec.fade_depth,
        added_to=spec.added_to,
    )


def model(values: Mapping[str, Any], dim: int, n_rows: int) -> DescriptorModel:
    """An untrained model with the options of a header."""
    return DescriptorModel(DescriptorModelOptions.from_json(values), dim, n_rows)


def correction(
    name: str, model: DescriptorModel, body: ReducedBody, collider: Collider, mechanics: BodyMechanics | None
) -> DescriptorCorrection:
    """The correction for one collider."""
    return DescriptorCorrection(name, model, body, collider)


FORM = LearnedForm(
    name=DescriptorModel.form,
    line="displacement field from a local descriptor of any collider (thesis, chapter 6)",
    needs_mechanics=False,
    options=options,
    model=model,
    correction=correction,
)
