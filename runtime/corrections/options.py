"""From a [[training.models]] table to the architecture of a model."""

from __future__ import annotations

from runtime.corrections.descriptor_model import DescriptorModelOptions
from runtime.corrections.load_model import LoadModelOptions
from runtime.corrections.model import ModelOptions
from runtime.experiment.training_schema import ModelSpec


def model_options(spec: ModelSpec) -> ModelOptions:
    """The architecture that a [[training.models]] table of form "field" asks for."""
    return ModelOptions(
        encoding=spec.encoding,
        patch_inputs=spec.patch_inputs,
        widths=spec.hidden,
        activation=spec.activation,
        fade=spec.fade,
        fade_depth=spec.fade_depth,
    )


def load_model_options(spec: ModelSpec, stiffness: float) -> LoadModelOptions:
    """The architecture that a [[training.models]] table of form "loads" asks for; stiffness of contact
    [N/m^4]."""
    return LoadModelOptions(
        widths=spec.hidden,
        activation=spec.activation,
        fade_depth=spec.fade_depth,
        band=spec.band,
        stiffness=stiffness,
    )


def descriptor_model_options(spec: ModelSpec, radius: float) -> DescriptorModelOptions:
    """The architecture that a [[training.models]] table of form "descriptor" asks for; radius: d [m]."""
    return DescriptorModelOptions(
        widths=spec.hidden,
        activation=spec.activation,
        radius=radius,
        sets=spec.differences,
        samples=spec.samples,
        fade_depth=spec.fade_depth,
    )
