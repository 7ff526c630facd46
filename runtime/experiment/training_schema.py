"""The `[training]` table: how corrections are learned from the truth file (thesis 5.3.1)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from runtime.experiment.section import Count, Name, NotNegative, Positive, Section


class ModelSpec(Section):
    """`[[training.models]]`: one correction to train. The form of the thesis is

    form = "field", hidden = [250, 250], activation = "tanh".
    """

    name: Name = Field(description="file name of the correction and its name in simulations and reports")
    form: Literal["loads", "field", "descriptor"] = Field(
        "loads",
        description="loads: a network corrects the contact forces of the body's linear compliance; field: a "
        "network is the displacement field (thesis, eq. 5.4); descriptor: the displacement from a local descriptor of "
        "any collider (thesis, eq. 6.5)",
    )
    hidden: Annotated[tuple[Count, ...], Field(min_length=1)] = Field(
        (96, 96), description="neurons of each hidden layer"
    )
    activation: Literal["tanh", "silu", "softplus", "elu"] = Field(
        "silu", description="of every hidden layer"
    )
    fade_depth: Positive = Field(
        5e-4, description="depth of contact below which what is learned fades out [m]"
    )
    loads: Count = Field(3000, description="form loads: at most so many surface points that bear forces")
    band: Positive = Field(2e-3, description="form loads: loads this far outside the collider take part [m]")
    internal: bool = Field(
        True,
        description="form loads: the body settles inside where the subspace cannot follow (linear, nothing learned)",
    )
    learned: bool = Field(
        True,
        description="form loads: false for linear mechanics alone, what the network would have to improve on",
    )
    encoding: Literal["weighted_rows", "local_geometry"] = Field(
        "weighted_rows",
        description="form field: the thesis's weighted handle rows, or the geometry of the contact",
    )
    patch_inputs: bool = Field(
        False, description="form field: tell the network about the contact patch as a whole"
    )
    fade: Literal["saturating", "proportional"] = Field(
        "saturating",
        description="form field: the field only vanishes as contact opens, or grows with its depth",
    )
    differences: Annotated[int, Field(ge=0)] = Field(
        16, description="form descriptor: sets of finite differences that smooth the normal; 0: not smoothed"
    )
    samples: Literal["all", "half", "one"] = Field(
        "all",
        description="form descriptor: points of the descriptor; half: those towards the collider, one: the centre",
    )


class FieldTrainingSpec(Section):
    """`[training.field]`: how models of form field are trained; they need smaller and far more steps than loads."""

    steps: Count = Field(8500, description="optimiser steps for each model")
    batch: Count = Field(64, description="pools of points of one optimiser step")
    learning_rate: Positive = Field(5e-3, description="at the start; falls to zero along a cosine")
    weight_decay: NotNegative = Field(0.0, description="decoupled weight decay (AdamW)")
    pools: Count = Field(16, description="pools of points drawn from a sample, on average")
    nodes: Count = Field(16, description="nodes of a pool")
    edges: Count = Field(4, description="surface edges of a pool")
    validations: Count = Field(
        10, description="as training.validations; all nodes are evaluated, it takes a while"
    )
    input_gain: Positive = Field(3.0, description="initial weights of all inputs, relative to torch's")
    position_gain: Positive = Field(
        8.0, description="initial weights of the position z, relative to those of the other inputs"
    )


class DescriptorTrainingSpec(Section):
    """`[training.descriptor]`: how models of form descriptor are trained."""

    steps: Count = Field(20_000, description="optimiser steps for each model")
    batch: Count = Field(512, description="points of one optimiser step")
    learning_rate: Positive = Field(6e-3, description="at the start; falls to zero along a cosine")
    weight_decay: NotNegative = Field(1e-4, description="decoupled weight decay (AdamW)")
    validations: Count = Field(20, description="how often along a run the held-out error is measured")
    points: Count = Field(96, description="points of interest drawn from a sample")
    frames: Count = Field(2, description="random tangent frames of each point")
    consistency: NotNegative = Field(
        1.0,
        description="weight of what the frames of a point disagree about, beside their mean squared error",
    )
    input_gain: Positive = Field(3.0, description="initial weights of all inputs, relative to torch's")


class TrainingSpec(Section):
    """`[training]`: settings of all models; what `[training.field]` or `[training.descriptor]` has too is for
    models of form loads."""

    collider: str = Field(
        "",
        description='name of the collider, or "library": from its training shapes, for any collider; may be left out '
        "where there is no choice",
    )
    steps: Count = Field(2500, description="optimiser steps for each model of form loads")
    batch: Count = Field(32, description="samples of one optimiser step")
    learning_rate: Positive = Field(3e-3, description="at the start; falls to zero along a cosine")
    weight_decay: NotNegative = Field(1e-3, description="decoupled weight decay (AdamW)")
    edge_weight: NotNegative = Field(
        0.3, description="weight of the surface-edge term beside the volume term"
    )
    validation_states: Count = Field(1, description="states held out for the validation curve")
    validations: Count = Field(20, description="how often along a run the held-out error is measured")
    validation_samples: Count = Field(200, description="at most so many held-out samples, drawn evenly")
    device: Literal["cpu", "cuda"] = Field("cpu", description="where the networks are trained")
    field: FieldTrainingSpec = FieldTrainingSpec()
    descriptor: DescriptorTrainingSpec = DescriptorTrainingSpec()
    models: tuple[ModelSpec, ...] = Field((), description="the corrections to train")
