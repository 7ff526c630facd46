"""Experiment files (TOML): schema, checks, and reading.

`schema/` has a module for the tables of each section; those of `[[colliders]]` are in `runtime/colliders/kinds/`,
those of materials are named in `runtime/elasticity/materials/`, the kinds of learned corrections in `runtime/learned/`.
"""

from softprint.runtime.experiment.experiment import Experiment, ExperimentSpec
from softprint.runtime.experiment.load import load_experiment
from softprint.runtime.experiment.schema.body import (
    BodySpec,
    FrameSpec,
    HandlesSpec,
    MaterialRegionSpec,
    MaterialSpec,
)
from softprint.runtime.experiment.schema.dynamics import ContactSpec, DynamicsSpec
from softprint.runtime.experiment.schema.sampling import SamplingSpec, SolverSpec
from softprint.runtime.experiment.schema.scene import KeyframeSpec, SceneColliderSpec, SceneSpec, SpringSpec
from softprint.runtime.experiment.schema.training import InternalSpec, ModelSpec, TrainingSpec

__all__ = [
    "BodySpec",
    "ContactSpec",
    "DynamicsSpec",
    "Experiment",
    "ExperimentSpec",
    "FrameSpec",
    "HandlesSpec",
    "InternalSpec",
    "KeyframeSpec",
    "MaterialRegionSpec",
    "MaterialSpec",
    "ModelSpec",
    "SamplingSpec",
    "SceneColliderSpec",
    "SceneSpec",
    "SolverSpec",
    "SpringSpec",
    "TrainingSpec",
    "load_experiment",
]
