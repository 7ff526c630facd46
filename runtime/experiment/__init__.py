"""One experiment, one TOML file: its schema, its checks, and how it is read.

Import the collider specs, which other packages need without the rest, from
`runtime.experiment.colliders_schema`.
"""

from runtime.experiment.body_schema import BodySpec, FrameSpec, HandlesSpec, MaterialRegionSpec, MaterialSpec
from runtime.experiment.dynamics_schema import ContactSpec, DynamicsSpec
from runtime.experiment.experiment import Experiment, ExperimentSpec
from runtime.experiment.load import load_experiment
from runtime.experiment.sampling_schema import SamplingSpec, SolverSpec
from runtime.experiment.scene_schema import KeyframeSpec, SceneColliderSpec, SceneSpec, SpringSpec
from runtime.experiment.training_schema import ModelSpec, TrainingSpec

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
