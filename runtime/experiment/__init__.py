"""Experiment files (TOML): schema, checks, and reading.

Each `*_schema.py` holds the tables of one section; those of `[[colliders]]` are in `runtime/colliders/kinds/`, those of
materials are named in `runtime/elasticity/materials/`, the kinds of learned corrections in `runtime/learned/`.
"""

from softprint.runtime.experiment.body_schema import (
    BodySpec,
    FrameSpec,
    HandlesSpec,
    MaterialRegionSpec,
    MaterialSpec,
)
from softprint.runtime.experiment.dynamics_schema import ContactSpec, DynamicsSpec
from softprint.runtime.experiment.experiment import Experiment, ExperimentSpec
from softprint.runtime.experiment.load import load_experiment
from softprint.runtime.experiment.sampling_schema import SamplingSpec, SolverSpec
from softprint.runtime.experiment.scene_schema import KeyframeSpec, SceneColliderSpec, SceneSpec, SpringSpec
from softprint.runtime.experiment.training_schema import ModelSpec, TrainingSpec

__all__ = [
    "BodySpec",
    "ContactSpec",
    "DynamicsSpec",
    "Experiment",
    "ExperimentSpec",
    "FrameSpec",
    "HandlesSpec",
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
