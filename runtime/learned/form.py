"""The interface of one kind of learned correction, implemented by `thesis5`, `thesis6` and `force`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from importlib import import_module
from typing import Any, ClassVar, Generic, Self, TypeVar

from torch import nn

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.correction import Correction
from softprint.runtime.learned.registry import FORMS
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


@dataclass(frozen=True)
class ModelOptions:
    """Architecture of a model, stored in the header of its file. Every kind has `widths`, the neurons of each hidden
    layer.

    added_to: name of the internal correction of the body that the model is added to, empty for none."""

    added_to: str = field(default="", kw_only=True)

    def to_json(self) -> dict[str, Any]:
        """As plain values for a file's header."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """From the values of :meth:`to_json`. Raises TypeError or KeyError for anything else."""
        return cls(**{**values, "widths": tuple(values["widths"])})


class LearnedModel(nn.Module):
    """A network with the normalisation of its inputs and outputs. form: the name of its kind; dim, n_rows: dimension
    and number of handle rows of its bodies."""

    form: ClassVar[str]
    options: ModelOptions
    dim: int
    n_rows: int


ModelT = TypeVar("ModelT", bound=LearnedModel)


@dataclass(frozen=True)
class LearnedForm(Generic[ModelT]):
    """One kind of learned correction.

    name: in experiment files and headers, and of its folder; line: a description for `softprint inspect`;
    needs_mechanics: whether it adds to the linear mechanics of the body, which are then passed to `correction`;
    options: makes them from a [[training.models]] table, a body and the contact law;
    model: makes an untrained one from the options of a header, dim and n_rows;
    correction: makes one from a name, a trained model, a body, a collider and the mechanics of the body.
    """

    name: str
    line: str
    needs_mechanics: bool
    options: Callable[[ModelSpec, ReducedBody, PenaltyContact], ModelOptions]
    model: Callable[[Mapping[str, Any], int, int], ModelT]
    correction: Callable[[str, ModelT, ReducedBody, Collider, BodyMechanics | None], Correction]


def find_form(name: str) -> LearnedForm[Any]:
    """The form of that name. Raises ValueError for an unknown name."""
    if name not in FORMS:
        raise ValueError(f"form {name!r} is not known; known forms: {', '.join(FORMS)}")
    found: LearnedForm[Any] = import_module(f"softprint.runtime.learned.{name}.entry").FORM
    return found
