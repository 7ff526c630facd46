"""The `[training]` table: how corrections are learned from the truth file (thesis 5.3.1)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from runtime.experiment.section import Count, Name, NotNegative, Positive, Section


class ModelSpec(Section):
    """`[[training.models]]`: one correction to train."""

    name: Name = Field(description="file name of the correction and its name in simulations and reports")
    hidden: Annotated[tuple[Count, ...], Field(min_length=1)] = Field(
        (256, 256), description="neurons of each hidden layer"
    )
    activation: Literal["tanh", "silu", "gelu", "sine"] = Field("tanh", description="of every hidden layer")


class TrainingSpec(Section):
    """`[training]`: settings shared by all models."""

    collider: str = Field("", description="name of the collider; may be left out where there is only one")
    epochs: Count = Field(60, description="passes over the training samples")
    batch: Count = Field(16, description="samples of one optimiser step")
    learning_rate: Positive = Field(2e-3, description="largest learning rate")
    edge_weight: NotNegative = Field(1.0, description="weight of the surface-edge term beside the volume term")
    validation_share: Annotated[float, Field(gt=0, lt=1)] = Field(
        0.15, description="share of the contacts held out for the validation curve"
    )
    models: tuple[ModelSpec, ...] = Field((), description="the corrections to train")
