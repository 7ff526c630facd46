"""From a [[training.models]] table to the architecture of a model."""

from __future__ import annotations

from runtime.experiment.training_schema import ModelSpec
from runtime.learned.force.model import ForceModelOptions
from runtime.learned.thesis5.model import ContactCentricOptions
from runtime.learned.thesis6.model import DescriptorModelOptions


def contact_centric_options(spec: ModelSpec) -> ContactCentricOptions:
    """The architecture that a [[training.models]] table of form "field" asks for."""
    return ContactCentricOptions(
        encoding=spec.encoding,
        patch_inputs=spec.patch_inputs,
        widths=spec.hidden,
        activation=spec.activation,
        fade=spec.fade,
        fade_depth=spec.fade_depth,
    )


def force_model_options(spec: ModelSpec, stiffness: float) -> ForceModelOptions:
    """The architecture that a [[training.models]] table of form "loads" asks for; stiffness of contact
    [N/m^4]."""
    return ForceModelOptions(
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
