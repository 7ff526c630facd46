"""The object-centric correction as a kind of correction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.form import LearnedForm
from softprint.runtime.learned.thesis4.correction import ObjectCentricCorrection
from softprint.runtime.learned.thesis4.inputs import InteractionState
from softprint.runtime.learned.thesis4.model import ObjectCentricModel, ObjectCentricOptions
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


def options(spec: ModelSpec, body: ReducedBody, law: PenaltyContact) -> ObjectCentricOptions:
    """The architecture that a [[training.models]] table asks for. Raises SoftprintError for another activation than
    tanh."""
    if "activation" in spec.model_fields_set and spec.activation != "tanh":
        raise SoftprintError(
            f'model {spec.name!r}: activation = "{spec.activation}", but models of form thesis4 have tanh layers: '
            "leave it out"
        )
    return ObjectCentricOptions(
        widths=spec.hidden,
        components=spec.components,
        n_inputs=InteractionState.of(body).n_inputs(len(spec.parameters)),
        n_nodes=body.n_nodes,
        parameters=spec.parameters,
        target=spec.target,
        added_to=spec.added_to,
        fade=spec.fade,
        fade_depth=spec.fade_depth,
    )


def model(values: Mapping[str, Any], dim: int, n_rows: int) -> ObjectCentricModel:
    """An untrained model with the options of a header."""
    return ObjectCentricModel(ObjectCentricOptions.from_json(values), dim, n_rows)


def correction(
    name: str,
    model: ObjectCentricModel,
    body: ReducedBody,
    collider: Collider,
    mechanics: BodyMechanics | None,
) -> ObjectCentricCorrection:
    """The correction for one collider."""
    return ObjectCentricCorrection(name, model, body, collider)


FORM = LearnedForm(
    name=ObjectCentricModel.form,
    line="displacement of a body by one shape, object-centric (thesis, chapter 4)",
    needs_mechanics=False,
    options=options,
    model=model,
    correction=correction,
)
