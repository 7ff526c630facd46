"""The `[training]` table: how corrections are trained on the truth file (thesis 5.3.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from softprint.runtime.experiment.schema.section import Count, Name, NotNegative, Positive, Section
from softprint.runtime.learned.registry import FORMS

if TYPE_CHECKING:
    Form = str
else:
    Form = Literal[tuple(FORMS)]

# What simulations and reports have of their own.
_RESERVED = ("full", "bare", "condensed", "linear_response", "truth", "statics")
# The forms that a key of [[training.models]] is for; all others are for every form.
_FORMS_OF = {
    **dict.fromkeys(("contact_nodes", "band", "static_condensation", "learned"), ("force",)),
    **dict.fromkeys(("components", "parameters", "target"), ("thesis4",)),
    **dict.fromkeys(("encoding", "patch_inputs"), ("thesis5",)),
    **dict.fromkeys(("differences", "samples"), ("thesis6",)),
    "fade": ("thesis4", "thesis5"),
}


def _not_reserved(name: str) -> str:
    if name in _RESERVED:
        raise ValueError(f"{name!r} is what simulations or reports call a model of their own: choose another name")
    return name


CorrectionName = Annotated[Name, AfterValidator(_not_reserved)]


class ModelSpec(Section):
    """`[[training.models]]`: one correction to train. The network of thesis chapter 5 is

    form = "thesis5", hidden = [250, 250], activation = "tanh".
    """

    name: CorrectionName = Field(description="name of the correction in files, simulations and reports")
    form: Form = Field(
        "force",
        description="; ".join(f"{name}: {form.description}" for name, form in FORMS.items()),
    )
    hidden: Annotated[tuple[Count, ...], Field(min_length=1)] = Field(
        (96, 96), description="neurons of each hidden layer"
    )
    activation: Literal["tanh", "silu", "softplus", "elu"] = Field(
        "silu", description="of every hidden layer"
    )
    fade_depth: Positive = Field(
        5e-4, description="depth of contact below which the correction fades out [m]"
    )
    contact_nodes: Count = Field(
        3000, description="form force: limit of surface nodes that contact forces act on"
    )
    band: Positive = Field(
        2e-3,
        description="form force: contact points up to this distance outside the collider are included [m]",
    )
    static_condensation: bool = Field(
        True,
        description="form force: add the linear equilibrium of the interior that the subspace cannot represent",
    )
    learned: bool = Field(True, description="form force: false for linear mechanics alone, without a network")
    encoding: Literal["weighted_rows", "all_rows", "local_geometry"] = Field(
        "weighted_rows",
        description="form thesis5: handle rows weighted by the basis at the point (sparse, thesis eq. 5.4), all of "
        "them as they are (dense, eq. 5.3), or the geometry of the contact",
    )
    patch_inputs: bool = Field(
        False, description="form thesis5: also inputs that describe the whole contact patch"
    )
    components: Count = Field(50, description="form thesis4: principal components of the displacement")
    parameters: tuple[Literal["size"], ...] = Field(
        (),
        description="form thesis4: what colliders of one shape differ in, inputs of the network too; size: half of the "
        "largest extent, of a sphere its radius",
    )
    target: Literal["contact", "whole"] = Field(
        "contact",
        description="form thesis4: learn what contact adds (thesis eq. 4.9), or all that the subspace lacks in contact",
    )
    added_to: str = Field(
        "",
        description="name of a correction of [[training.internal]] that it is added to; condensed: to static "
        "condensation, which form force has by itself",
    )
    fade: Literal["saturating", "proportional"] = Field(
        "saturating",
        description="forms thesis4 and thesis5: the displacement vanishes as contact opens, or is proportional to its "
        "depth",
    )
    differences: Annotated[int, Field(ge=0)] = Field(
        16, description="form thesis6: sets of finite differences that smooth the normal; 0: not smoothed"
    )
    samples: Literal["all", "half", "one"] = Field(
        "all",
        description="form thesis6: points of the descriptor; half: those facing the collider, one: the centre",
    )

    @model_validator(mode="after")
    def _keys_of_the_form(self) -> Self:
        foreign = sorted(key for key in self.model_fields_set if self.form not in _FORMS_OF.get(key, FORMS))
        if foreign:
            raise ValueError(f'form = "{self.form}" has no {", ".join(foreign)}: leave it out')
        return self


class InternalSpec(Section):
    """`[[training.internal]]`: one internal correction of the body, learned from the states of the truth file.

    The thesis has hidden = [100, 100], components = 15, linear = false, derivatives = false (table 4.1).
    """

    name: CorrectionName = Field(description="name of the correction in files, simulations and reports")
    on: Literal["subspace", "condensation"] = Field(
        "subspace", description="what it is added to: U q alone, or static condensation as well"
    )
    equilibrium: bool = Field(
        False,
        description="without a network: the principal components are modes, whose amplitudes are those of least "
        "elastic energy at every state",
    )
    quadratic: bool = Field(
        False,
        description="without a network: quadratic in the state, fitted in closed form to the equilibria and their "
        "derivatives",
    )
    hidden: Annotated[tuple[Count, ...], Field(min_length=1)] = Field(
        (200, 200), description="neurons of each hidden layer; their activation is tanh"
    )
    components: Count = Field(100, description="principal components of the displacement")
    linear: bool = Field(True, description="fit a linear part first, and train the network on the rest")
    derivatives: bool = Field(
        True, description="train on the derivatives of the equilibria by the reduced state, too"
    )
    cubature: Count | None = Field(
        None,
        description="cells of its own cubature, whose weights are fitted to forces in the training states; without, "
        "the cubature of the body is used",
    )
    steps: Count = Field(8000, description="optimiser steps")
    batch: Count = Field(64, description="states of one optimiser step")
    learning_rate: Positive = Field(6e-3, description="at the start; falls to zero along a cosine")
    weight_decay: NotNegative = Field(1e-4, description="decoupled weight decay (AdamW)")
    validations: Count = Field(20, description="number of times that a run measures the held-out error")

    @model_validator(mode="after")
    def _without_network(self) -> Self:
        if self.equilibrium and self.quadratic:
            raise ValueError(
                "equilibrium = true and quadratic = true are two corrections: give each its own table"
            )
        if self.equilibrium and self.on != "subspace":
            raise ValueError('with equilibrium = true it is on the subspace: leave "on" out')
        if self.equilibrium or self.quadratic:
            kept = {"name", "on", "equilibrium", "quadratic", "components", "cubature"}
            learned = sorted(self.model_fields_set - kept)
            if learned:
                kind = "equilibrium" if self.equilibrium else "quadratic"
                raise ValueError(
                    f"with {kind} = true there is no network to train: leave {', '.join(learned)} out"
                )
        return self


class Thesis4TrainingSpec(Section):
    """`[training.thesis4]`: how models of form thesis4 are trained."""

    steps: Count = Field(4000, description="optimiser steps for each model")
    batch: Count = Field(512, description="samples of one optimiser step")
    learning_rate: Positive = Field(1e-2, description="at the start; falls to zero along a cosine")
    weight_decay: NotNegative = Field(0.0, description="decoupled weight decay (AdamW)")
    validations: Count = Field(20, description="number of times that a run measures the held-out error")
    input_gain: Positive = Field(4.0, description="initial weights of all inputs, relative to torch's")


class Thesis5TrainingSpec(Section):
    """`[training.thesis5]`: how models of form thesis5 are trained; they need more and smaller steps than force."""

    steps: Count = Field(8500, description="optimiser steps for each model")
    batch: Count = Field(64, description="pools of points of one optimiser step")
    learning_rate: Positive = Field(5e-3, description="at the start; falls to zero along a cosine")
    weight_decay: NotNegative = Field(0.0, description="decoupled weight decay (AdamW)")
    pools: Count = Field(16, description="pools of points drawn from a sample, on average")
    nodes: Count = Field(16, description="nodes of a pool")
    edges: Count = Field(4, description="surface edges of a pool")
    validations: Count = Field(
        10, description="as training.validations; slow, because all nodes are evaluated"
    )
    input_gain: Positive = Field(3.0, description="initial weights of all inputs, relative to torch's")
    position_gain: Positive = Field(
        8.0, description="initial weights of the position z, relative to those of the other inputs"
    )


class Thesis6TrainingSpec(Section):
    """`[training.thesis6]`: how models of form thesis6 are trained."""

    steps: Count = Field(20_000, description="optimiser steps for each model")
    batch: Count = Field(512, description="points of one optimiser step")
    learning_rate: Positive = Field(6e-3, description="at the start; falls to zero along a cosine")
    weight_decay: NotNegative = Field(1e-4, description="decoupled weight decay (AdamW)")
    validations: Count = Field(20, description="number of times that a run measures the held-out error")
    points: Count = Field(96, description="points of interest drawn from a sample")
    frames: Count = Field(2, description="random tangent frames of each point")
    consistency: NotNegative = Field(
        1.0,
        description="weight of the variance between the frames of a point, relative to their mean squared error",
    )
    input_gain: Positive = Field(3.0, description="initial weights of all inputs, relative to torch's")


class TrainingSpec(Section):
    """`[training]`: settings of all models; keys that the tables of other forms, such as `[training.thesis5]`, also
    have apply to models of form force."""

    collider: str = Field(
        "",
        description='name of the collider, or "library": trained on its training shapes, for any collider; optional '
        "if there is only one choice",
    )
    steps: Count = Field(2500, description="optimiser steps for each model of form force")
    batch: Count = Field(32, description="samples of one optimiser step")
    learning_rate: Positive = Field(3e-3, description="at the start; falls to zero along a cosine")
    weight_decay: NotNegative = Field(1e-3, description="decoupled weight decay (AdamW)")
    edge_weight: NotNegative = Field(
        0.3, description="weight of the surface-edge term relative to the volume term"
    )
    validation_states: Count = Field(
        1,
        description="states held out to choose the weights of the other forms by; form force learns from all",
    )
    validations: Count = Field(20, description="number of times that a run measures the held-out error")
    validation_samples: Count = Field(200, description="limit of held-out samples, drawn at random")
    device: Literal["cpu", "cuda"] = Field("cpu", description="device on which the networks are trained")
    thesis4: Thesis4TrainingSpec = Thesis4TrainingSpec()
    thesis5: Thesis5TrainingSpec = Thesis5TrainingSpec()
    thesis6: Thesis6TrainingSpec = Thesis6TrainingSpec()
    models: tuple[ModelSpec, ...] = Field((), description="the corrections to train")
    internal: tuple[InternalSpec, ...] = Field(
        (), description="the internal corrections of the body to train"
    )
