"""Learned contact forces as a kind of correction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.learned.form import LearnedForm
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


def options(spec: ModelSpec, body: ReducedBody, law: PenaltyContact) -> ForceModelOptions:
    """The architecture that a [[training.models]] table asks for; law: of contact."""
    return ForceModelOptions(
        widths=spec.hidden,
        activation=spec.activation,
        fade_depth=spec.fade_depth,
        band=spec.band,
        stiffness=law.stiffness,
        static_condensation=spec.static_condensation,
        refinement=law.refinement,
        reduced_refinement=law.reduced_refinement,
        added_to=spec.added_to,
    )


def model(values: Mapping[str, Any], dim: int, n_rows: int) -> ForceModel:
    """An untrained model with the options of a header."""
    return ForceModel(ForceModelOptions.from_json(values), dim, n_rows)


def correction(
    name: str, model: ForceModel, body: ReducedBody, collider: Collider, mechanics: BodyMechanics | None
) -> ForceCorrection:
    """The correction for one collider. Raises ValueError without mechanics."""
    if mechanics is None:
        raise ValueError(f"correction {name!r} needs the mechanics of its body")
    own = mechanics if model.options.static_condensation else mechanics._replace(condensation=None)
    own = model.settled(body, own)
    return ForceCorrection(name, model, body, collider, own)


FORM = LearnedForm(
    name=ForceModel.form,
    line="contact forces, added to those of the linear mechanics of the body",
    needs_mechanics=True,
    options=options,
    model=model,
    correction=correction,
)
